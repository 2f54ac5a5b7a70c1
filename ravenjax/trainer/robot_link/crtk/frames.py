"""Where CRTK has an arm's poses: in the base frame of raven2's own CRTK interface, fixed to frame 0 of the arm.

A point p of frame 0 is BASE p there, a rotation R is BASE R: the axes of the jaws stay as they are. Source: raven2
`src/raven/crtk_motion_api.cpp`; its `params/raven_*_crtk.yaml` give poses to check with.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ravenjax.numbers.lazy import at_once, jax, jnp
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import kinematics, transmission
from ravenjax.robots.raven2.geometry.mapping import matrix_from_quat, quat_from_matrix
from ravenjax.trainer.robot_link.crtk.messages import TipPose

BASE: dict[ArmName, np.ndarray] = {
    "gold": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "green": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}


def from_frame0(arm: ArmName, position: np.ndarray, rotation: np.ndarray) -> TipPose:
    """The pose, position m [3], rotation [3, 3], as CRTK tells it."""
    x, y, z = (BASE[arm] @ position).tolist()
    with at_once():
        qx, qy, qz, qw = map(float, quat_from_matrix(Vec(Vec(row) for row in (BASE[arm] @ rotation).tolist())))
    return TipPose((x, y, z), (qx, qy, qz, qw))


def to_frame0(arm: ArmName, pose: TipPose) -> tuple[np.ndarray, np.ndarray]:
    """Position, m, and rotation in frame 0 of the arm."""
    with at_once():
        rotation = np.array(matrix_from_quat(Vec(pose.quat)), float)
    return BASE[arm].T @ np.array(pose.position), BASE[arm].T @ rotation


def reached(arm: ArmName, jpos: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Position, m, and rotation of the jaws in frame 0 at joints `jpos` [7], rad and m."""
    with at_once():
        pose = kinematics.forward(arm, Vec(map(float, jpos)))
    return np.array(pose.position, float), np.array(pose.rotation, float)


class ArmReading(NamedTuple):
    """What an arm does, in frame 0."""

    jvel: np.ndarray  # [7] rad/s, insertion m/s
    position: np.ndarray  # [3] m, as measured
    rotation: np.ndarray  # [3, 3]
    position_d: np.ndarray  # as the software wants it
    rotation_d: np.ndarray
    linear: np.ndarray  # [3] m/s, of the jaw axis
    angular: np.ndarray  # [3] rad/s, of the jaws' frame


class Kinematics:
    """Of the arms of one robot, compiled: joints in, poses and velocities out."""

    def __init__(self, arms: tuple[ArmName, ...], tools: tuple[str, ...]) -> None:
        self.arms = arms

        def read(arm: str, tool: str, jpos: Vec, jpos_d: Vec, mvel: Vec) -> list:
            jvel = transmission.joint_from_motor(arm, tool, mvel)
            rates = Vec((*jvel[:5], (jvel[6] - jvel[5]) * 0.5))
            measured, wanted = kinematics.forward(arm, jpos), kinematics.forward(arm, jpos_d)
            twist = [sum(a * b for a, b in zip(row, rates, strict=True)) for row in kinematics.jacobian(arm, jpos)]
            poses = [*measured.position, *_rows(measured), *wanted.position, *_rows(wanted)]
            return [*jvel, *poses, *twist]

        def whole(numbers: jax.Array) -> jax.Array:
            each = [[Vec(numbers[i, 7 * k + j] for j in range(7)) for k in range(3)] for i in range(len(arms))]
            return jnp.stack([jnp.stack(read(arm, tool, *of)) for arm, tool, of in zip(arms, tools, each, strict=True)])

        self._whole = jax.jit(whole)

    def read(self, jpos: np.ndarray, jpos_d: np.ndarray, mvel: np.ndarray) -> list[ArmReading]:
        """Of each arm; each argument [arms, 7], rad, m, rad/s."""
        with jax.enable_x64(True):
            rows = np.asarray(self._whole(np.concatenate([jpos, jpos_d, mvel], axis=1).astype(np.float64)))
        return [
            ArmReading(
                *(row[0:7], row[7:10], row[10:19].reshape(3, 3)),
                *(row[19:22], row[22:31].reshape(3, 3), row[31:34], row[34:37]),
            )
            for row in rows
        ]


def _rows(pose: kinematics.Pose) -> list:
    return [x for row in pose.rotation for x in row]
