"""Draws the three-dimensional scene from frames: arms, ghosts, forces, task.

The roots of viser's node tree are /robot, /ghost, /virtual, /force, /task and /plumb. Viser sends
only changes.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import pickle
from importlib import metadata
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import viser

from ravenjax.campaign import compile_cache
from ravenjax.engines import trace_key
from ravenjax.robots.raven2.dynamics import arm_model, body_shapes
from ravenjax.robots.raven2.dynamics.scene_views import ENDOSCOPES, FIELD, VIEWS, view_pose
from ravenjax.train.page.hub import Client
from ravenjax.train.page.marks import MODEL, DepthLine, Rgb, TaskShapes
from ravenjax.train.page.server import window
from ravenjax.train.protocol.frame import VIRTUAL, Frame
from ravenjax.train.protocol.messages import Command, Event, Json
from ravenjax.train.protocol.world import TISSUE, frame0_in_world, jaw_tips, tissue_height
from ravenjax.train.robot import ARMS, ArmName, Arms

_LOOKS = {"ghost": (MODEL, 0.36), "virtual": ((120, 226, 170), 0.75)}
"""Colour and opacity of the figures that are not the robot."""
GHOST_MM = (0.5, 0.8)
"""A ghost disappears below the first distance and appears above the second."""
FORCE, CONTACT = (255, 190, 60), (70, 200, 150)
CONTACT_M = 0.03
"""m of arrow per N of contact force."""
FORCE_M = 0.9
"""m of arrow per device unit; the published cue ends at 0.05."""
SHADOW = 0.3
"""Darkness of the shadows that shapes receive."""
_SHAPE_MAKERS = ("mujoco", "mjviser", "trimesh")


def read_shapes(model: mujoco.MjModel) -> dict[int, tuple[bytes, np.ndarray, np.ndarray]]:
    """Return by body its GLB file, and vertices [n, 3], m, and faces [m, 3] of its plain mesh.

    The result is cached on disk, because making it takes seconds.
    """
    objects = compile_cache.object_cache()
    content = np.zeros(mujoco.mj_sizeModel(model), np.uint8)
    mujoco.mj_saveModel(model, None, content)
    source = Path(body_shapes.__file__).read_bytes()
    key = trace_key.hash_values(content, source, [metadata.version(name) for name in _SHAPE_MAKERS])
    if objects is not None and (stored := objects.get(key)) is not None:
        return pickle.loads(stored)
    bodies = [*body_shapes.fixed_bodies(model)]
    bodies += [body for arm in ARMS for body in body_shapes.moving_bodies(model, arm)]
    shapes = {}
    for body in bodies:
        mesh = body_shapes.plain_mesh(model, body)
        arrays = np.asarray(mesh.vertices), np.asarray(mesh.faces)
        shapes[body] = body_shapes.coloured_glb(model, body), *arrays
    if objects is not None:
        objects[key] = pickle.dumps(shapes)
    return shapes


class RobotFigure:
    """All moving links of some arms in one style, which follow joint positions."""

    def __init__(
        self,
        server: viser.ViserServer,
        layer: str,
        model: mujoco.MjModel,
        arms: Arms,
        shapes: dict[int, tuple[bytes, np.ndarray, np.ndarray]],
    ) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._data.qpos[:] = model.key("home").qpos
        self._qpos = {
            arm: [int(model.joint(name).qposadr[0]) for name in arm_model.joint_names(arm)]
            for arm in arms
        }
        self._nodes: dict[int, Any] = {}
        for arm in arms:
            for body, body_name in body_shapes.moving_bodies(model, arm).items():
                name, (glb, *mesh) = f"/{layer}/{body_name}", shapes[body]
                if layer == "robot":
                    node = server.scene.add_glb(name, glb, receive_shadow=SHADOW)
                else:
                    colour, opacity = _LOOKS[layer]
                    node = server.scene.add_mesh_simple(
                        name,
                        *mesh,
                        color=colour,
                        opacity=opacity,
                        cast_shadow=False,
                        receive_shadow=False,
                    )
                self._nodes[body] = node
        self._place()

    def show(self, frame: Frame, channel: str) -> None:
        """Move the links to the joint positions of this channel."""
        for arm, places in self._qpos.items():
            if f"{arm}/{channel}" in frame.layout.places:
                self._data.qpos[places] = frame[f"{arm}/{channel}"]
        self._place()

    def set_visible(self, visible: bool) -> None:
        for node in self._nodes.values():
            node.visible = visible

    def _place(self) -> None:
        mujoco.mj_kinematics(self._model, self._data)
        for body, node in self._nodes.items():
            node.position, node.wxyz = self._data.xpos[body], self._data.xquat[body]


class Scene:
    """Everything that is drawn, for every window."""

    def __init__(
        self,
        server: viser.ViserServer,
        arms: Arms,
        task: Json | None,
        blinded: bool,
    ) -> None:
        """blinded: neither ghost nor force is drawn, because they show what must stay hidden."""
        model = arm_model.operating_scene()
        self._server, self._arms = server, arms
        self._frames = {arm: tuple(map(np.array, frame0_in_world(arm))) for arm in arms}
        shapes = read_shapes(model)
        shown = () if blinded else arms
        with server.atomic():
            data = mujoco.MjData(model)
            mujoco.mj_kinematics(model, data)
            for body, name in body_shapes.fixed_bodies(model).items():
                server.scene.add_glb(
                    f"/fixed/{name}",
                    shapes[body][0],
                    position=data.xpos[body],
                    wxyz=data.xquat[body],
                    receive_shadow=SHADOW,
                )
            self._robot = RobotFigure(server, "robot", model, ARMS, shapes)
            self._virtual = RobotFigure(server, "virtual", model, arms, shapes)
            self._ghosts = {
                arm: RobotFigure(server, "ghost", model, (arm,), shapes) for arm in shown
            }
            self._has_ghost = dict.fromkeys(shown, False)
            self._forces = {arm: _add_arrow(server, arm, FORCE) for arm in shown}
            self._contacts = {arm: _add_arrow(server, f"contact_{arm}", CONTACT) for arm in arms}
            self._depth_lines = {arm: DepthLine(server, arm) for arm in arms}
            self._task = TaskShapes(server, task or {})
        for figure in (self._virtual, *self._ghosts.values()):
            figure.set_visible(False)

    def update(self, frame: Frame) -> None:
        tips: dict[str, np.ndarray] = {}
        with self._server.atomic():
            self._robot.show(frame, "link_jpos")
            is_virtual = frame.number("view") == VIRTUAL
            self._virtual.set_visible(is_virtual)
            if is_virtual:
                self._virtual.show(frame, "virtual_jpos")
            is_felt = frame.number("cue_on") != 0
            for arm in self._arms:
                origin, turn = self._frames[arm]
                tip = tips[arm] = origin + turn @ frame[f"{arm}/tip"]
                if arm in self._ghosts:
                    _point(self._forces[arm], tip, FORCE_M * turn @ frame[f"{arm}/force"] * is_felt)
                    least_mm = GHOST_MM[not self._has_ghost[arm]]
                    self._has_ghost[arm] = bool(frame.number(f"{arm}/error_mm") > least_mm)
                    self._ghosts[arm].set_visible(self._has_ghost[arm])
                    if self._has_ghost[arm]:
                        self._ghosts[arm].show(frame, "model_jpos")
                contact = turn @ frame[f"{arm}/contact"]
                _point(self._contacts[arm], self._deeper_jaw(frame, arm), CONTACT_M * contact)
                self._depth_lines[arm].show(tip)
            self._task.show(int(frame.number("target")), tips)
        self._server.flush()

    def _deeper_jaw(self, frame: Frame, arm: ArmName) -> np.ndarray:
        """Return the jaw tip, world, that is deeper in the tissue: most of the force acts there."""
        origin, turn = self._frames[arm]
        tip, jpos = frame[f"{arm}/tip"].tolist(), frame[f"{arm}/link_jpos"].tolist()
        ends = [origin + turn @ np.array(end) for end in jaw_tips(arm, tip, jpos)]
        return min(ends, key=lambda end: end[2] - tissue_height(float(end[0]), float(end[1])))

    def follow(self, event: Event) -> None:
        """Take an event of the session that changes the scene."""
        if event.get("kind") == "object":
            self._task.follow(event)


def describe_place(arms: Arms) -> Json:
    """Return JSON of where the arms and the tissue are, m, for a window that draws tips itself."""
    return {
        "bases": {
            arm: dict(zip(("origin", "turn"), frame0_in_world(arm), strict=True)) for arm in arms
        },
        "tissue": TISSUE,
    }


def _add_arrow(server: viser.ViserServer, name: str, colour: Rgb) -> Any:
    return server.scene.add_arrows(
        f"/force/{name}",
        np.zeros((1, 2, 3), np.float32),
        colour,
        shaft_radius=0.0011,
        head_radius=0.003,
        head_length=0.007,
        visible=False,
    )


def _point(arrow: Any, tip: np.ndarray, along: np.ndarray) -> None:
    arrow.visible = bool(np.abs(along).max() > 1e-6)
    if arrow.visible:
        arrow.points = np.array([[tip, tip + along]], np.float32)


FIRST = "endoscope"
FAR = "theatre"
"""An inset with this view has no letters: they would hide the instruments."""
# The endoscope's light: colour, candela.
LAMP, LAMP_CD = (255, 246, 235), 0.008
UP = (0.0, 0.0, 1.0)


class Windows:
    """The viser clients, by the name of the window to which each belongs."""

    def __init__(self) -> None:
        self._clients: dict[str, viser.ClientHandle] = {}

    def watch(self, server: viser.ViserServer) -> None:
        """Set the scene's look, and register each client that connects."""
        camera = server.initial_camera
        camera.position, camera.look_at, camera.fov = view_pose(FIRST)
        camera.up, camera.near = UP, 0.01
        server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        server.scene.configure_environment_map("studio", environment_intensity=0.3)
        server.scene.configure_default_lights(True, cast_shadow=True)
        lamp = tuple(FIELD + ENDOSCOPES[FIRST])
        server.scene.add_light_point(
            "/lamp", color=LAMP, intensity=LAMP_CD, position=lamp, cast_shadow=False
        )

        @server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            name = window.get() or str(client.client_id)
            self._clients[name] = client
            _, _, inset = name.partition(".")
            if inset in VIEWS:
                _look_from(client, inset)
            if inset == FAR:
                # This client's node is the parent of the scene's nodes /plumb/... and hides them.
                client.scene.add_frame("/plumb", show_axes=False, visible=False)

        @server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            for name, known in list(self._clients.items()):
                if known.client_id == client.client_id:
                    del self._clients[name]

    def obey(self, client: Client, message: Command) -> None:
        """Carry out a window's request: {"do": "camera", "name"} or {"do": "shadows", "on"}."""
        handle, name = self._clients.get(client.window), message.get("name")
        if handle is not None and message["do"] == "shadows":
            handle.scene.configure_default_lights(True, cast_shadow=message["on"])
        elif handle is not None and name in VIEWS:
            _look_from(handle, name)


def _look_from(client: viser.ClientHandle, name: str) -> None:
    place, focus, fov = view_pose(name)
    with client.atomic():
        client.camera.position, client.camera.look_at = place, focus
        client.camera.up_direction, client.camera.fov = UP, fov
