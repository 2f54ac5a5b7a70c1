"""Where CRTK has an arm's poses: in the base frame of raven2's own CRTK interface, fixed to frame 0
of the arm.

A point p of frame 0 is BASE p there, a rotation R is BASE R: the axes of the jaws stay as they are.
Source: raven2 `src/raven/crtk_motion_api.cpp`; its `params/raven_*_crtk.yaml` give poses to check
with.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ravenjax.numbers.lazy import at_once
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import kinematics, transmission
from ravenjax.robots.raven2.geometry.mapping import matrix_from_quat, quat_from_matrix
from ravenjax.train.protocol.frame import Frame
from ravenjax.train.robot_link.crtk.messages import TipPose

BASE: dict[ArmName, np.ndarray] = {
    "gold": np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]]),
    "green": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
}


def from_frame0(arm: ArmName, position: np.ndarray, rotation: np.ndarray) -> TipPose:
    """The pose, position m [3], rotation [3, 3], as CRTK tells it."""
    x, y, z = (BASE[arm] @ position).tolist()
    with at_once():
        qx, qy, qz, qw = map(
            float, quat_from_matrix(Vec(Vec(row) for row in (BASE[arm] @ rotation).tolist()))
        )
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


def pressing(frame: Frame, arm: ArmName) -> np.ndarray:
    """The force that the instrument exerts on what it touches, N, frame 0: against the one that it
    feels.

    CRTK's `servo_cf` is a force of the robot on its environment, and its `measured_cf` the
    Jacobian's of the measured joint efforts, which hold that force.
    """
    return -frame[f"{arm}/contact"].astype(float) + 0.0  # no -0


class ArmReading(NamedTuple):
    """What an arm does, in frame 0."""

    jvel: np.ndarray  # [7] rad/s, insertion m/s
    position: np.ndarray  # [3] m, as measured
    rotation: np.ndarray  # [3, 3]
    position_d: np.ndarray  # as the software wants it
    rotation_d: np.ndarray
    linear: np.ndarray  # [3] m/s, of the jaw axis
    angular: np.ndarray  # [3] rad/s, of the jaws' frame


def read(
    arm: ArmName, tool: str, jpos: np.ndarray, jpos_d: np.ndarray, mvel: np.ndarray
) -> ArmReading:
    """What an arm does: joints at `jpos`, wanted at `jpos_d`, rad and m, motors at `mvel`,
    rad/s; each [7].
    """
    with at_once():
        jvel = np.array(transmission.joint_from_motor(arm, tool, Vec(map(float, mvel))), float)
        jacobian = np.array(kinematics.jacobian(arm, Vec(map(float, jpos))), float)
    twist = jacobian @ (*jvel[:5], 0.5 * (jvel[6] - jvel[5]))
    return ArmReading(jvel, *reached(arm, jpos), *reached(arm, jpos_d), twist[:3], twist[3:])
