"""Provides functions and constants of the simulated Raven-II that training sessions use.

Modules that compile a tick or draw the arms import the robot's modules directly.
"""

# ruff: noqa: F401

import math
from collections.abc import Sequence
from functools import cache

import numpy as np

from ravenjax.numbers.lazy import run_eagerly
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2 import ROBOT, run_levels
from ravenjax.robots.raven2.arms import ARMS, JOINTS, ArmName
from ravenjax.robots.raven2.console.choice import UNDECIDED, ProfileChoice, matching_profile
from ravenjax.robots.raven2.console.motion import ARM_COLUMNS
from ravenjax.robots.raven2.console.packet import DELTAS, U_STRUCT, UDP_PORT, V_STRUCT, Packet
from ravenjax.robots.raven2.console.profile import ConsoleProfile
from ravenjax.robots.raven2.console.reading import FIELDS, MODE, Misfit
from ravenjax.robots.raven2.geometry import instrument, kinematics, scene, transmission
from ravenjax.robots.raven2.geometry.arrays import jaw_rotation
from ravenjax.robots.raven2.geometry.instrument import JAW_LENGTH
from ravenjax.robots.raven2.geometry.joints import GEOMETRY, GM1, GM2, GM3
from ravenjax.robots.raven2.geometry.limits import soft_limits
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES, quat_mul
from ravenjax.robots.raven2.plant import parameter_sets
from ravenjax.robots.raven2.run_levels import E_STOP, INIT, PEDAL_DOWN, PEDAL_UP
from ravenjax.robots.raven2.stages.network import RESET_GAP
from ravenjax.robots.raven2.stages.teleoperation import NO_PACKET_SEQUENCE

Arms = tuple[ArmName, ...]
Quat = tuple[float, float, float, float]
"""Quaternion in the order x, y, z, w."""


def tip_pose(arm: ArmName, jpos: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return position, m [3], and rotation [3, 3] of the jaws in frame 0, at joints [7]."""
    with run_eagerly():
        pose = kinematics.forward_pose(arm, Vec(map(float, jpos)))
    return np.array(pose.position, float), np.array(pose.rotation, float)


def jaw_tips(arm: ArmName, jpos: Sequence[float] | np.ndarray) -> list[np.ndarray]:
    """Return the ends of both jaws, m [3], in frame 0, at joints [7]."""
    with run_eagerly():
        tips = instrument.jaw_tips(arm, Vec(map(float, jpos)))
    return [np.array(tip.position, float) for tip in tips]


def tip_twist(arm: ArmName, jpos: np.ndarray, jvel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return velocity, m/s, and angular velocity, rad/s, of the jaws in frame 0."""
    with run_eagerly():
        jacobian = np.array(kinematics.tip_jacobian(arm, Vec(map(float, jpos))), float)
    # The jaws' angles have opposite signs, so their middle turns at half the difference of rates.
    twist = jacobian @ (*jvel[:5], 0.5 * (jvel[6] - jvel[5]))
    return twist[:3], twist[3:]


@cache
def motor_matrix(arm: ArmName, tool: str) -> np.ndarray:
    """Return the matrix [7, 7] from joint positions to motor positions, and from rates to rates."""
    with run_eagerly():
        columns = [transmission.motor_from_joint(arm, tool, Vec(row)) for row in np.eye(7).tolist()]
    return np.array(columns, float).T


def unit_quaternion(quat: Sequence[float]) -> Quat:
    """Return the quaternion scaled to length 1. Raises ValueError if it is zero."""
    x, y, z, w = quat
    length = math.hypot(x, y, z, w)
    if not length:
        raise ValueError("expected a quaternion of length 1, not 0")
    return x / length, y / length, z / length, w / length


def turn_by(first: Sequence[float], second: Sequence[float]) -> Quat:
    """Return the rotation `first` followed by the rotation `second`, as a unit quaternion."""
    return unit_quaternion(quat_mul(Vec(second), Vec(first)))
