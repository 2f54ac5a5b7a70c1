"""Fixed geometry of the arms, modified Denavit-Hartenberg convention (Craig). Without JAX.

Source of all figures: raven2 `src/raven/r2_kinematics.cpp`, `include/raven/r2_kinematics.h`. Frames
0 to 3 of an arm share their origin, the remote centre. Frame 6 is on the jaw axis.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from ravenjax.numbers.trigonometry import cos, sin

PI = math.pi
LINK12 = math.radians(75.0)  # rad, La12: shoulder axis to elbow axis
LINK23 = math.radians(52.0)  # rad, La23: elbow axis to insertion axis
GM1, GM2 = sin(LINK12), cos(LINK12)
GM3, GM4 = sin(LINK23), cos(LINK23)
D4 = -0.47  # m, remote centre to wrist axis at insertion 0
LW = 0.013  # m, Lw: wrist axis to jaw axis, Raven tool; the original uses it for every tool


class Geometry(NamedTuple):
    """Constants that differ between the arms."""

    zero1: float  # rad, theta1 = shoulder + zero1
    zero2: float  # rad, theta2 = elbow + zero2
    flip: float  # 1 or -1: frame 0 turned by alpha0 = 180 deg about x
    cos23: float  # cos(alpha2)
    side: float  # sin(theta3), theta3 = +-90 deg


GEOMETRY = {
    # The source has 205 deg for the shoulder. A full turn less keeps float32 angles small in the
    # working range.
    "gold": Geometry(math.radians(-155.0), PI, 1.0, -GM4, 1.0),
    "green": Geometry(math.radians(25.0), 0.0, -1.0, GM4, -1.0),
}
