"""Draws the three-dimensional scene of the training page: arms, ghosts, forces, depth lines, task.

The scene shows the current target, the next target smaller, and the last reached targets in grey.
All targets at once would hide the tip. The current target is pink, and a ring around it shrinks as
the tip approaches. The library viser sends changes of the scene to browsers. The roots of its node
tree are /robot, /ghost, /virtual, /force, /task and /plumb.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import contextvars
import pickle
from importlib import metadata
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import viser

from ravenjax import resources
from ravenjax.campaign import compile_cache
from ravenjax.engines import trace_key
from ravenjax.robots.raven2.dynamics import arm_model, body_shapes
from ravenjax.robots.raven2.dynamics.scene_views import ENDOSCOPES, FIELD_CENTRE, VIEWS, view_pose
from ravenjax.train import protocol
from ravenjax.train.page.hub import Client
from ravenjax.train.protocol import Command, Event, Frame, Json, tissue_height
from ravenjax.train.robot import ARMS, ArmName, Arms, jaw_tips, scene

Rgb = tuple[int, int, int]
Shapes = dict[int, tuple[bytes, np.ndarray, np.ndarray]]
"""Of each body: its GLB file, and the vertices [n, 3], m, and faces [m, 3] of its mesh."""

STYLES = resources.read_tables(__file__, "scene.toml")
GOAL_COLOUR = (245, 61, 240)
REACHED_COLOUR = (118, 135, 154)
# Relative sizes of pegs that are not the goal, of the next target, and of targets reached.
PEG_SCALE, NEXT_SCALE, REACHED_SCALE = 0.55, 0.5, 0.35
SHOWN_REACHED = 5
RING_M = (0.004, 0.03)
"""Least and greatest radius of the ring around the goal."""
_ANGLES = np.linspace(0, 2 * np.pi, 49)
_RING = np.stack([np.cos(_ANGLES), np.sin(_ANGLES), np.zeros(49)], axis=1)
_FLAT: Json = {"cast_shadow": False, "receive_shadow": False}
_NO_SEGMENT = np.zeros((1, 2, 3), np.float32)
GHOST_MM = (0.5, 0.8)
"""A ghost disappears below the first distance from the robot and appears above the second."""
CONTACT_M_PER_N = 0.03  # m of arrow per N of contact force
FORCE_M_PER_UNIT = 0.9  # m of arrow per device unit; the published cue ends at 0.05
_SHAPE_MAKERS = ("mujoco", "mjviser", "trimesh")
FIRST_VIEW = "endoscope"
VIEW_WITHOUT_LETTERS = "theatre"
"""View of an inset without letters, which would hide the instruments."""
UP = (0.0, 0.0, 1.0)
window: contextvars.ContextVar[str] = contextvars.ContextVar("window", default="")
"""The browser window to which the viser client of this task belongs; see `early.js`."""


class DepthLine:
    """Shows which instrument is which, and how high its tip is. A letter is beside the tip, a
    dotted line leads down to the tissue, and a spot marks its end.
    """

    def __init__(self, server: viser.ViserServer, arm: ArmName):
        root = f"/plumb/{arm}"
        nodes, self._name = server.scene, STYLES["letters"][arm]["text"]
        self._line = nodes.add_line_segments(f"{root}/line", _NO_SEGMENT, **STYLES["plumb"])
        self._spot = nodes.add_cylinder(f"{root}/spot", **STYLES["spot"])
        self._letter = nodes.add_label(f"{root}/letter", **STYLES["letters"][arm])
        self._rest = nodes.add_label(f"{root}/rest", **STYLES["rests"][arm])

    def show(self, tip: np.ndarray, real_tip: np.ndarray, is_virtual: bool) -> None:
        """Follow the tip that the hand moves, and name a real robot that rests. Tips: world, m."""
        self._letter.position, self._rest.position = tip + STYLES["above_tip"], real_tip
        self._letter.text = self._name + " virtual" * is_virtual
        self._rest.visible = is_virtual
        foot = np.array([*tip[:2], tissue_height(*tip[:2])])
        is_above_tissue = bool(np.all(np.abs(tip[:2]) < scene.TISSUE_HALF[:2]))
        self._line.visible = self._spot.visible = is_above_tissue
        self._line.points = np.array([[tip, foot]], np.float32)
        self._spot.position = foot


class TaskShapes:
    """Scene nodes of one task, made from its geometry, m, in the world: {"targets": [{"number",
    "at", "radius_m", "colour", "arm"}], "pegs": [{"number", "at" (the top), "height_m", "radius_m",
    "colour"}], "object": {"number", "at", "radius_m", "colour"} or None, "path": {"points",
    "radius_m", "colour"} or None}; all optional.
    """

    _goal: int | None = None
    _object: Any = None
    _holder = ""
    _path_ball: Any = None

    def __init__(self, server: viser.ViserServer, geometry: Json):
        self._server = server
        self._markers: dict[int, tuple[Any, Rgb]] = {}
        self._places: dict[int, np.ndarray] = {}  # position of each possible goal, by its number
        targets = geometry.get("targets") or ()
        self._arm_of_target = {int(target["number"]): target.get("arm", "") for target in targets}
        ring = segments_of_path(_RING)
        self._ring = server.scene.add_line_segments("/task/ring", ring, **STYLES["ring"])
        if path := geometry.get("path"):
            points = np.asarray(path["points"], float)
            line, colour = segments_of_path(points), _rgb(path["colour"])
            server.scene.add_line_segments("/task/path", line, colour, **STYLES["path"])
            self._places = dict(enumerate(points))
            self._path_ball = self._add_ball(
                "on_path", path["radius_m"], GOAL_COLOUR, opacity=0.55, visible=False
            )
        for target in targets:
            self._add_marker(f"target/{target['number']}", target, opacity=0.55)
        for peg in geometry.get("pegs") or ():
            (x, y, top), height = peg["at"], peg["height_m"]
            stem, colour = f"/task/stem/{peg['number']}", _rgb(peg["colour"])
            middle = (x, y, top - height / 2)
            server.scene.add_cylinder(stem, peg["radius_m"], height, color=colour, position=middle)
            self._add_marker(f"peg/{peg['number']}", peg, opacity=0.7)
        if carried := geometry.get("object"):
            self._object = self._add_marker("object", carried, opacity=None)

    def follow(self, event: Event) -> None:
        """Process an event of kind "object": an arm took the object or released it."""
        self._holder = event.get("held", "")
        if self._object is not None and "at" in event:
            self._object.position = tuple(event["at"])

    def show(self, goal: int, tips: dict[str, np.ndarray]) -> None:
        """Mark the present goal (-1: none), and move a held object with the tip. tips: world, m."""
        if self._object is not None and self._holder in tips:
            self._object.position = tips[self._holder]
        self._draw_ring(goal, tips)
        if goal == self._goal:
            return
        self._goal = goal
        if self._path_ball is not None:
            self._path_ball.visible = goal in self._places
            self._path_ball.position = tuple(self._places.get(goal, np.zeros(3)))
        for number, (node, colour) in self._markers.items():
            if number == goal:
                scale, colour = 1.0, GOAL_COLOUR
            elif number not in self._arm_of_target:
                scale = PEG_SCALE
            # A target. Without a goal, all targets have been reached.
            elif goal < 0 or number < goal:
                scale, colour = REACHED_SCALE, REACHED_COLOUR
            else:
                scale = NEXT_SCALE
            # Only the last reached targets, the goal and the next target are visible.
            if number in self._arm_of_target:
                node.visible = goal < 0 or goal - SHOWN_REACHED <= number <= goal + 1
            node.scale, node.color = scale, colour

    def _draw_ring(self, goal: int, tips: dict[str, np.ndarray]):
        """Draw a ring around the goal. Its radius is the distance of the nearest tip among the arms
        that may reach the goal, within `RING_M`.
        """
        place = self._places.get(goal)
        arms = [arm for arm in tips if self._arm_of_target.get(goal, "") in ("", arm)]
        self._ring.visible = place is not None and bool(arms)
        if place is not None and arms:
            self._ring.position = tuple(place)
            distance = min(np.linalg.norm(tips[arm] - place) for arm in arms)
            self._ring.scale = float(np.clip(distance, *RING_M))

    def _add_ball(
        self, name: str, radius: float, colour: Rgb, opacity: float | None, **settings
    ) -> Any:
        return self._server.scene.add_icosphere(
            f"/task/{name}", radius, color=colour, opacity=opacity, **_FLAT, **settings
        )

    def _add_marker(self, name: str, spot: Json, opacity: float | None) -> Any:
        # Adds a ball for a target, a peg or the object, and returns its node.
        colour, number, position = _rgb(spot["colour"]), int(spot["number"]), spot["at"]
        node = self._add_ball(name, spot["radius_m"], colour, opacity, position=tuple(position))
        self._markers[number] = node, colour
        self._places[number] = np.asarray(position, float)
        return node


def segments_of_path(path: np.ndarray) -> np.ndarray:
    """Return the segments [n - 1, 2, 3] between points [n, 3]."""
    return np.stack([path[:-1], path[1:]], axis=1).astype(np.float32)


def _rgb(colour: str) -> Rgb:
    red, green, blue = bytes.fromhex(colour[1:])
    return red, green, blue


def read_shapes(model: mujoco.MjModel) -> Shapes:
    """Return the shapes of all bodies of the model, from the cache if they are stored there. Their
    computation takes seconds. The key of the cache is the model and the code that computes.
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
    """Draws the moving links of some arms in one style, at given joint positions."""

    def __init__(
        self,
        server: viser.ViserServer,
        layer: str,
        model: mujoco.MjModel,
        arms: Arms,
        shapes: Shapes,
    ):
        """layer: "robot", "ghost" or "virtual". The last two have a style in scene.toml."""
        self._model, self._data = model, mujoco.MjData(model)
        self._data.qpos[:] = model.key("home").qpos
        self._qpos = {
            arm: [int(model.joint(name).qposadr[0]) for name in arm_model.joint_names(arm)]
            for arm in arms
        }
        self._nodes: dict[int, Any] = {}
        for arm in arms:
            for body, body_name in body_shapes.moving_bodies(model, arm).items():
                name, (glb, vertices, faces) = f"/{layer}/{body_name}", shapes[body]
                if layer == "robot":
                    node = server.scene.add_glb(name, glb, receive_shadow=True)
                else:
                    node = server.scene.add_mesh_simple(name, vertices, faces, **STYLES[layer])
                self._nodes[body] = node
        self._place()

    def show(self, frame: Frame, channel: str) -> None:
        """Move the links to the joint positions in this channel of a frame."""
        for arm, places in self._qpos.items():
            if f"{arm}/{channel}" in frame.layout.places:
                self._data.qpos[places] = frame[f"{arm}/{channel}"]
        self._place()

    def set_visible(self, visible: bool) -> None:
        for node in self._nodes.values():
            node.visible = visible

    def _place(self):
        mujoco.mj_kinematics(self._model, self._data)
        for body, node in self._nodes.items():
            node.position, node.wxyz = self._data.xpos[body], self._data.xquat[body]


class Scene:
    """The scene that every window shows."""

    def __init__(self, server: viser.ViserServer, arms: Arms, task: Json | None, blinded: bool):
        """blinded: whether ghost and force are left out, which would show cue and hazard."""
        model = arm_model.operating_scene()
        self._server, self._arms = server, arms
        self._frames = {arm: tuple(map(np.array, protocol.frame0_in_world(arm))) for arm in arms}
        shapes = read_shapes(model)
        ghost_arms = () if blinded else arms

        def add_arrows(kind: str, arms: Arms) -> dict[ArmName, Any]:
            # Adds an arrow of this kind for each arm.
            return {
                arm: server.scene.add_arrows(f"/force/{kind}_{arm}", _NO_SEGMENT, **STYLES[kind])
                for arm in arms
            }

        with server.atomic():
            data = mujoco.MjData(model)
            mujoco.mj_kinematics(model, data)
            for body, name in body_shapes.fixed_bodies(model).items():
                pose = {"position": data.xpos[body], "wxyz": data.xquat[body]}
                glb, _, _ = shapes[body]
                server.scene.add_glb(f"/fixed/{name}", glb, **pose, receive_shadow=True)
            self._robot = RobotFigure(server, "robot", model, ARMS, shapes)
            self._virtual = RobotFigure(server, "virtual", model, arms, shapes)
            self._ghosts = {
                arm: RobotFigure(server, "ghost", model, (arm,), shapes) for arm in ghost_arms
            }
            self._has_ghost = dict.fromkeys(ghost_arms, False)
            self._contacts = add_arrows("contact", arms)
            self._forces = add_arrows("force", ghost_arms)
            self._depth_lines = {arm: DepthLine(server, arm) for arm in arms}
            self._task = TaskShapes(server, task or {})
        for figure in (self._virtual, *self._ghosts.values()):
            figure.set_visible(False)

    def update(self, frame: Frame) -> None:
        # Draws the robot, the virtual robot, ghosts, forces and the task as in this frame.
        tips = {}
        with self._server.atomic():
            self._robot.show(frame, "link_jpos")
            is_virtual = frame.number("view") == protocol.VIRTUAL
            self._virtual.set_visible(is_virtual)
            if is_virtual:
                self._virtual.show(frame, "virtual_jpos")
            is_felt = frame.number("cue_on") != 0
            for arm in self._arms:
                origin, turn = self._frames[arm]
                tip = origin + turn @ frame[f"{arm}/tip"]
                driven = "virtual_tip" if is_virtual else "tip"
                tips[arm] = origin + turn @ frame[f"{arm}/{driven}"]
                if arm in self._ghosts:
                    arrow_m = FORCE_M_PER_UNIT * turn @ frame[f"{arm}/force"] * is_felt
                    _point(self._forces[arm], tip, arrow_m)
                    # A visible ghost has the lower threshold, so that it does not flicker.
                    threshold_mm = GHOST_MM[not self._has_ghost[arm]]
                    self._has_ghost[arm] = bool(frame.number(f"{arm}/error_mm") > threshold_mm)
                    self._ghosts[arm].set_visible(self._has_ghost[arm])
                    if self._has_ghost[arm]:
                        self._ghosts[arm].show(frame, "model_jpos")
                contact = turn @ frame[f"{arm}/contact"]
                # Without contact, the arrow is hidden.
                start = self._deeper_jaw(frame, arm) if contact.any() else tip
                _point(self._contacts[arm], start, CONTACT_M_PER_N * contact)
                self._depth_lines[arm].show(tips[arm], tip, is_virtual)
            self._task.show(int(frame.number("target")), tips)
        self._server.flush()

    def _deeper_jaw(self, frame: Frame, arm: ArmName) -> np.ndarray:
        """Return the jaw tip, world, that is deeper in the tissue, where most of the force acts."""
        origin, turn = self._frames[arm]
        ends = [origin + turn @ end for end in jaw_tips(arm, frame[f"{arm}/link_jpos"])]
        return min(ends, key=lambda end: end[2] - tissue_height(*end[:2]))

    def follow(self, event: Event) -> None:
        """Process an event of the session. Only events of kind "object" change the scene."""
        if event.get("kind") == "object":
            self._task.follow(event)


def describe_field(arms: Arms) -> Json:
    """Return the positions of arms and tissue as JSON, m, for the 2D view."""
    return {
        "bases": {
            arm: dict(zip(("origin", "turn"), protocol.frame0_in_world(arm), strict=True))
            for arm in arms
        },
        "tissue": protocol.TISSUE,
    }


def _point(arrow, tip: np.ndarray, along: np.ndarray):
    arrow.visible = bool(np.abs(along).max() > 1e-6)
    if arrow.visible:
        arrow.points = np.array([[tip, tip + along]], np.float32)


class Windows:
    """Registers the viser clients by the names of their browser windows."""

    def __init__(self):
        self._clients: dict[str, viser.ClientHandle] = {}

    def watch(self, server: viser.ViserServer) -> None:
        """Set the scene's look, and register each client that connects."""
        camera = server.initial_camera
        camera.position, camera.look_at, camera.fov = view_pose(FIRST_VIEW)
        camera.up, camera.near = UP, 0.01
        server.gui.configure_theme(**STYLES["theme"])
        server.scene.configure_environment_map("studio", environment_intensity=0.3)
        server.scene.configure_default_lights(False)
        # `static/scene.js` replaces this light by its own lights, and sets the materials.
        server.scene.add_light_directional("/key")
        lamp = tuple(FIELD_CENTRE + ENDOSCOPES[FIRST_VIEW])
        server.scene.add_light_point("/lamp", position=lamp, **STYLES["lamp"])

        @server.on_client_connect
        async def _(client: viser.ClientHandle) -> None:
            name = window.get() or str(client.client_id)
            self._clients[name] = client
            # An inset's name is WINDOW.VIEW, such as "k3f.theatre".
            _, _, inset = name.partition(".")
            if inset in VIEWS:
                _look_from(client, inset)
            if inset == VIEW_WITHOUT_LETTERS:
                # The letters are below /plumb. This client's own node /plumb hides them.
                client.scene.add_frame("/plumb", show_axes=False, visible=False)

        @server.on_client_disconnect
        async def _(client: viser.ClientHandle) -> None:
            for name, known in [*self._clients.items()]:
                if known.client_id == client.client_id:
                    del self._clients[name]

    def set_camera(self, client: Client, message: Command) -> None:
        """Set a window's camera, as its message {"do": "camera", "name"} requests."""
        handle, name = self._clients.get(client.window), str(message.get("name"))
        if handle is not None and name in VIEWS:
            _look_from(handle, name)


def _look_from(client: viser.ClientHandle, name: str):
    place, focus, fov = view_pose(name)
    with client.atomic():
        client.camera.position, client.camera.look_at = place, focus
        client.camera.up_direction, client.camera.fov = UP, fov
