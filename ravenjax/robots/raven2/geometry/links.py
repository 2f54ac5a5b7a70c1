"""Fixed geometry of the arms, modified Denavit-Hartenberg convention (Craig), and how the jaws
stand. Without jax.

Source of all figures: raven2 `src/raven/r2_kinematics.cpp`, `include/raven/r2_kinematics.h`. Frames
0 to 3 of an arm share their origin, the remote centre; frame 6 sits on the jaw axis.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

PI = math.pi
LINK12 = math.radians(75.0)  # rad, La12: shoulder axis to elbow axis
LINK23 = math.radians(52.0)  # rad, La23: elbow axis to insertion axis
GM1, GM2 = math.sin(LINK12), math.cos(LINK12)
GM3, GM4 = math.sin(LINK23), math.cos(LINK23)
D4 = -0.47  # m, remote centre to wrist axis at insertion 0
LW = 0.013  # m, Lw: wrist axis to jaw axis, Raven tool; the original uses it for every tool


class Geometry(NamedTuple):
    """What differs between the arms."""

    zero1: float  # rad, theta1 = shoulder + zero1
    zero2: float  # rad, theta2 = elbow + zero2
    flip: float  # 1 or -1: frame 0 turned by alpha0 = 180 deg about x
    cos23: float  # cos(alpha2)
    side: float  # sin(theta3), theta3 = +-90 deg


GEOMETRY = {
    # 205 deg in the source for the shoulder; a full turn less keeps float32 angles small in the
    # working range.
    "gold": Geometry(math.radians(-155.0), PI, 1.0, -GM4, 1.0),
    "green": Geometry(math.radians(25.0), 0.0, -1.0, GM4, -1.0),
}


def jaw_rotation(arm: str, jpos: np.ndarray) -> np.ndarray:
    """Rotation [..., 3, 3] of the jaws in frame 0 of the arm, columns are the axes of frame 6; NaN
    where a joint is.

    jpos: [..., 7], rad and m, as `ravenjax.robots.raven2.arms.JOINTS`. The rotation of
    `kinematics.forward`, in NumPy.
    """
    turns, zeros = _links(arm)
    jpos = np.asarray(jpos, float)
    theta = np.zeros((*jpos.shape[:-1], len(zeros)))
    theta[..., [0, 1, 3, 4]] = jpos[
        ..., [0, 1, 3, 4]
    ]  # shoulder, elbow, roll, wrist; the insertion does not turn
    theta[..., 5] = (jpos[..., 6] - jpos[..., 5]) * 0.5
    theta += zeros
    links = np.zeros((*theta.shape, 3, 3))
    links[..., 0, 0] = links[..., 1, 1] = np.cos(theta)
    links[..., 1, 0] = np.sin(theta)
    links[..., 0, 1] = -links[..., 1, 0]
    links[..., 2, 2] = 1.0
    links = turns @ links
    while links.shape[-3] > 1:  # neighbours together: six, three, then two
        odd = links[..., -1:, :, :] if links.shape[-3] % 2 else links[..., :0, :, :]
        pairs = links[..., : links.shape[-3] // 2 * 2, :, :]
        links = np.concatenate([pairs[..., ::2, :, :] @ pairs[..., 1::2, :, :], odd], axis=-3)
    return links[..., 0, :, :]


@functools.cache
def _links(arm: str) -> tuple[np.ndarray, np.ndarray]:
    """Of the six rows of an arm's DH table: rotation by alpha about x [6, 3, 3], and theta at
    joint 0 [6], rad.
    """
    geometry = GEOMETRY[arm]
    alpha2 = PI - LINK23 if geometry.side > 0 else LINK23
    alphas = (0.0 if geometry.flip > 0 else PI, LINK12, alpha2, 0.0, PI / 2, PI / 2)
    zeros = (geometry.zero1, geometry.zero2, geometry.side * PI / 2, 0.0, -PI / 2, 0.0)
    turns = [
        [[1.0, 0.0, 0.0], [0.0, math.cos(a), -math.sin(a)], [0.0, math.sin(a), math.cos(a)]]
        for a in alphas
    ]
    return np.array(turns), np.array(zeros)
