"""The scene in three dimensions: both arms, their ghosts, trails, forces, the task; from frames to
viser's nodes.

Layers that a window may hide are the roots of the node tree: /robot, /ghost, /virtual, /trails,
/force, /task, /plumb.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
import viser

from ravenjax.robots.raven2.arms import ARMS, ArmName
from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.robots.raven2.geometry import scene
from ravenjax.train.page import bodies, colours, task_shapes
from ravenjax.train.page.kept_meshes import KeptMeshes
from ravenjax.train.page.plumb import Plumb
from ravenjax.train.page.trails import Trails
from ravenjax.train.protocol.frame import VIEWS, Frame
from ravenjax.train.protocol.jaws import jaw_tips
from ravenjax.train.protocol.world import surface

LAYERS = ("robot", "ghost", "virtual", "trails", "force", "task", "plumb")
GHOST, VIRTUAL = colours.MODEL, (120, 226, 170)
FORCE = (255, 190, 60)
GHOST_MM = (0.5, 0.8)
"""A ghost goes below the first and comes above the second: inside the robot it would only tint
it.
"""
CONTACT = (70, 200, 150)
CONTACT_M = 0.03  # m of arrow per N of contact
FORCE_M = 0.9  # m of arrow per device unit; the published cue ends at 0.05
SHADOW = 0.3  # how dark
_STILL_M, _STILL = 2e-6, 2e-5  # m and 1: what nobody sees is not sent


class RobotFigure:
    """All moving links of the session's arms in one look; follows joint positions."""

    def __init__(
        self,
        server: viser.ViserServer,
        layer: str,
        model: mujoco.MjModel,
        arms: tuple[ArmName, ...],
        meshes: KeptMeshes,
    ) -> None:
        self._model, self._data = model, mujoco.MjData(model)
        self._arms = arms
        self._data.qpos[:] = model.key("home").qpos
        self._places = {
            arm: [int(model.joint(name).qposadr[0]) for name in arm_model.joint_names(arm)]
            for arm in arms
        }
        self._nodes: list[tuple[int, Any]] = []
        self._sent: dict[int, np.ndarray] = {}
        self._visible = True
        for arm in arms:
            for body, name in bodies.names(model, bodies.moving(model, arm)):
                self._nodes.append((body, _drawn(server, f"/{layer}/{name}", meshes, body, layer)))
        self._place()

    @property
    def visible(self) -> bool:
        """Whether it is drawn."""
        return self._visible

    @visible.setter
    def visible(self, shown: bool) -> None:
        if shown != self._visible:
            self._visible = shown
            for _, node in self._nodes:
                node.visible = shown

    def show(self, frame: Frame, channel: str) -> None:
        """Take the joint positions of this channel."""
        for arm in self._arms:
            if f"{arm}/{channel}" in frame.layout.places:
                self._data.qpos[self._places[arm]] = frame[f"{arm}/{channel}"]
        self._place()

    def _place(self) -> None:
        mujoco.mj_kinematics(self._model, self._data)
        for body, node in self._nodes:
            position, turn = self._data.xpos[body], self._data.xquat[body]
            last = self._sent.get(body)
            if last is not None and _still(last, position, turn):
                continue
            self._sent[body] = np.concatenate([position, turn])
            node.position, node.wxyz = position, turn


def _still(last: np.ndarray, position: np.ndarray, turn: np.ndarray) -> bool:
    return bool(
        np.abs(last[:3] - position).max() < _STILL_M and np.abs(last[3:] - turn).max() < _STILL
    )


def _drawn(server: viser.ViserServer, name: str, meshes: KeptMeshes, body: int, layer: str) -> Any:
    if layer == "robot":
        return server.scene.add_glb(name, meshes.coloured(body), receive_shadow=SHADOW)
    vertices, faces = meshes.plain(body)
    colour, opacity = (GHOST, 0.36) if layer == "ghost" else (VIRTUAL, 0.75)
    return server.scene.add_mesh_simple(
        name,
        vertices,
        faces,
        color=colour,
        opacity=opacity,
        cast_shadow=False,
        receive_shadow=False,
    )


class World:
    """Everything that is drawn; one scene for every window."""

    def __init__(
        self,
        server: viser.ViserServer,
        arms: tuple[ArmName, ...],
        task: dict[str, Any] | None,
        blinded: bool,
    ) -> None:
        """blinded: neither ghost nor model's trail nor force is drawn, for they show what is not
        to be known.
        """
        model = arm_model.scene()
        self._server, self._arms = server, arms
        self._frames = {arm: _frame0(model, arm) for arm in arms}
        meshes = KeptMeshes(model)
        with server.atomic():
            _surroundings(server, model, meshes)
            self._robot = RobotFigure(server, "robot", model, ARMS, meshes)
            self._virtual = RobotFigure(server, "virtual", model, arms, meshes)
            self._ghosts = (
                {}
                if blinded
                else {arm: RobotFigure(server, "ghost", model, (arm,), meshes) for arm in arms}
            )
            self._trails = Trails(server, arms, blinded)
            self._arrows = {} if blinded else {arm: _arrow(server, arm) for arm in arms}
            self._contacts = {arm: _arrow(server, f"contact_{arm}", CONTACT) for arm in arms}
            self._plumb = Plumb(server, arms)
            self._task = task_shapes.TaskShapes(server, task or {})
        for figure in (self._virtual, *self._ghosts.values()):
            figure.visible = False

    def update(self, frame: Frame) -> None:
        """Draw this frame."""
        view = VIEWS[int(frame.number("view"))]
        tips: dict[str, np.ndarray] = {}
        with self._server.atomic():
            self._robot.show(frame, "link_jpos")
            self._virtual.visible = view == "virtual"
            if view == "virtual":
                self._virtual.show(frame, "virtual_jpos")
            for arm, ghost in self._ghosts.items():
                ghost.visible = frame.number(f"{arm}/error_mm") > (
                    GHOST_MM[0] if ghost.visible else GHOST_MM[1]
                )
                if ghost.visible:
                    ghost.show(frame, "model_jpos")
            for arm in self._arms:
                origin, turn = self._frames[arm]
                tip = tips[arm] = origin + turn @ frame[f"{arm}/tip"]
                self._trails.add(
                    arm,
                    tip,
                    origin + turn @ frame[f"{arm}/model_tip"],
                    int(frame.number("session_tick")),
                )
                if arm in self._arrows:
                    force = turn @ frame[f"{arm}/force"] * (frame.number("cue_on") != 0)
                    _point(self._arrows[arm], tip, FORCE_M * force)
                touch = turn @ frame[f"{arm}/contact"]
                _point(self._contacts[arm], self._touching(frame, arm), CONTACT_M * touch)
            self._trails.send()
            self._plumb.show(tips)
            self._task.show(int(frame.number("target")), tips)
        self._server.flush()

    def _touching(self, frame: Frame, arm: ArmName) -> np.ndarray:
        """The jaw tip that is deeper in the tissue, in the world: where most of the contact's
        force acts.
        """
        origin, turn = self._frames[arm]
        ends = [
            origin + turn @ np.array(end)
            for end in jaw_tips(
                arm, frame[f"{arm}/tip"].tolist(), frame[f"{arm}/link_jpos"].tolist()
            )
        ]
        return min(ends, key=lambda end: end[2] - surface(float(end[0]), float(end[1])))

    def tell(self, event: dict[str, Any]) -> None:
        """An event of the session that changes what is drawn."""
        if event.get("kind") == "object":
            self._task.moved(event)


def place(arms: tuple[ArmName, ...]) -> dict[str, Any]:
    """Where the arms and the tissue stand, for a window that draws tips itself: JSON, m, the
    world's axes.
    """
    bases = {arm: _frame0(arm_model.scene(), arm) for arm in arms}
    return {
        "bases": {
            arm: {"origin": origin.tolist(), "turn": turn.tolist()}
            for arm, (origin, turn) in bases.items()
        },
        "tissue": {"top": scene.TISSUE_TOP, "sag": scene.TISSUE_SAG, "half": scene.TISSUE_HALF},
    }


def _frame0(model: mujoco.MjModel, arm: ArmName) -> tuple[np.ndarray, np.ndarray]:
    """Origin (m) and rotation [3, 3] of the arm's frame 0 in the world."""
    body = model.body(arm_model.base(arm))
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, body.quat)
    return body.pos.copy(), turn.reshape(3, 3)


def _surroundings(server: viser.ViserServer, model: mujoco.MjModel, meshes: KeptMeshes) -> None:
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    for body, name in bodies.names(model, bodies.fixed(model)):
        server.scene.add_glb(
            f"/fixed/{name}",
            meshes.coloured(body),
            position=data.xpos[body],
            wxyz=data.xquat[body],
            receive_shadow=SHADOW,
        )


def _arrow(server: viser.ViserServer, name: str, colour: tuple[int, int, int] = FORCE) -> Any:
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
    visible = bool(np.abs(along).max() > 1e-6)
    if visible:
        arrow.points = np.array([[tip, tip + along]], np.float32)
    if arrow.visible != visible:
        arrow.visible = visible
