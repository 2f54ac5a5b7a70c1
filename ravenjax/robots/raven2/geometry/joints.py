"""Joints and links of one arm in the modified Denavit-Hartenberg convention (Craig).

Joint order and units: shoulder, elbow (rad), insertion (m), tool_roll, wrist, grasp1, grasp2 (rad).
Source of all figures: raven2 `src/raven/r2_kinematics.cpp`, `include/raven/r2_kinematics.h`.
Frames 0 to 3 of an arm share their origin, the remote centre. Frame 6 is on the jaw axis.
"""

import math
from typing import NamedTuple

from ravenjax.numbers import Scalar, Vec, jnp, record
from ravenjax.numbers.trigonometry import cos, sin

PI = math.pi
LINK12 = math.radians(75.0)  # rad, La12: shoulder axis to elbow axis
LINK23 = math.radians(52.0)  # rad, La23: elbow axis to insertion axis
GM1, GM2 = sin(LINK12), cos(LINK12)  # names of the source
GM3, GM4 = sin(LINK23), cos(LINK23)
D4 = -0.47  # m, remote centre to wrist axis at insertion 0
LW = 0.013  # m, Lw: wrist axis to jaw axis, Raven tool; the original uses it for every tool


class Geometry(NamedTuple):
    """Constants that differ between the arms."""

    zero1: float  # rad, theta1 = shoulder + zero1
    zero2: float  # rad, theta2 = elbow + zero2
    flip: float  # 1, or -1 if frame 0 is rotated by alpha0 = 180 deg about x
    cos23: float  # cos(alpha2)
    side: float  # sin(theta3), theta3 = +-90 deg


GEOMETRY = {
    # The source has 205 deg for the shoulder. A full turn less keeps angles in float32 small.
    "gold": Geometry(math.radians(-155.0), PI, 1.0, -GM4, 1.0),
    "green": Geometry(math.radians(25.0), 0.0, -1.0, GM4, -1.0),
}


@record
class Pose:
    """Pose of the jaw axis in frame 0 of its arm."""

    position: Vec  # 3, m
    rotation: Vec  # 3 rows of 3, the columns are the axes of frame 6


@record
class Theta:
    """Denavit-Hartenberg variables of one arm; theta3 is constant."""

    theta1: Scalar  # rad
    theta2: Scalar  # rad
    d3: Scalar  # m
    theta4: Scalar  # rad
    theta5: Scalar  # rad
    theta6: Scalar  # rad


def jaw_yaw(jpos: Vec) -> Scalar:
    """Return the jaw yaw, rad, positive toward jaw 2. The original rounds the difference of grasp2
    and grasp1 to float32 before it halves it.
    """
    return (jpos[6] - jpos[5]) * 0.5


def jaw_angles(yaw_rad: Scalar, grasp_rad: Scalar) -> tuple[Scalar, Scalar]:
    """Return grasp1 and grasp2, rad, of jaws with this yaw and this opening."""
    half = grasp_rad * 0.5
    return half - yaw_rad, half + yaw_rad


def wrap_angle(angle: Scalar) -> Scalar:
    """Return the angle, rad, shifted by whole turns into [-pi, pi]."""
    return angle - 2 * PI * jnp.round(angle * (0.5 / PI))


def theta_from_joint(arm: str, jpos: Vec) -> Theta:
    """Return the Denavit-Hartenberg variables of the joints `jpos` (7), angles in [-pi, pi]."""
    geometry = GEOMETRY[arm]
    # If zero2 is 0, no addition is needed
    return Theta(
        theta1=wrap_angle(jpos[0] + geometry.zero1),
        theta2=wrap_angle(jpos[1] + geometry.zero2) if geometry.zero2 else wrap_angle(jpos[1]),
        d3=jpos[2],
        theta4=wrap_angle(jpos[3]),
        theta5=wrap_angle(jpos[4] - PI / 2),
        theta6=wrap_angle(jaw_yaw(jpos)),
    )


def joint_from_theta(arm: str, theta: Theta, grasp_rad: Scalar) -> Vec:
    """Return the joints (7) of Denavit-Hartenberg variables, whose angles are in [-pi, pi]. Joint
    angles are brought into this range, too. Only the roll remains theta4, which the caller may have
    shifted by a turn.
    """
    geometry = GEOMETRY[arm]
    grasp1, grasp2 = jaw_angles(theta.theta6, grasp_rad)
    return Vec(
        (
            _add_offset(theta.theta1, -geometry.zero1),
            _add_offset(theta.theta2, -geometry.zero2),
            theta.d3,
            theta.theta4,
            _add_offset(theta.theta5, PI / 2),
            grasp1,
            grasp2,
        )
    )


def _add_offset(angle: Scalar, offset: float) -> Scalar:
    """Return angle + offset, shifted by at most one turn into [-pi, pi]."""
    if offset == 0.0:
        return angle
    joint, turn = angle + offset, math.copysign(2 * PI, offset)
    is_outside = joint > PI if offset > 0 else joint < -PI
    return jnp.where(is_outside, angle + (offset - turn), joint)
