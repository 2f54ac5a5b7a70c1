"""Registration: where the true arm stands in the frame in which its report is believed.

The rigid motion that brings true tips onto reported ones at POSES, by least squares (Gauss-Newton;
each step solves for a small rotation and a displacement). It is found before the run and does not
change.
"""

from __future__ import annotations

import functools
import itertools
import math

import numpy as np

from ravenjax.numbers.algebra import dot, matmul, matrix, matvec
from ravenjax.numbers.lazy import at_once, jnp
from ravenjax.numbers.vec import Scalar, Vec, record, where
from ravenjax.robots.raven2.geometry import kinematics, mapping

_DEG = math.pi / 180.0
STEPS = 4
"""Of Gauss-Newton; from 20 degrees on the fourth changes nothing that single precision holds."""

_RANGES = (
    (20 * _DEG, 50 * _DEG),
    (70 * _DEG, 110 * _DEG),
    (0.32, 0.40),
    (-45 * _DEG, 45 * _DEG),
    (0.0, 40 * _DEG),
)
"""Shoulder, elbow, insertion, roll, wrist: about where the recorded arm works
(`camera_poses_left_arm`).
"""
POSES = tuple(
    Vec(
        (
            *(ends[i] for ends, i in zip(_RANGES, (a, b, c, a ^ b, b ^ c), strict=True)),
            45 * _DEG,
            45 * _DEG,
        )
    )
    for a, b, c in itertools.product((0, 1), repeat=3)
)
"""Eight corners of those ranges: a quarter of all 32, in which each two joints take all four
pairs of ends.
"""


@record
class Registration:
    """A rigid motion: from frame 0 of the true arm to that of its report."""

    rotation: Vec  # 3 rows
    translation: Vec  # m, 3


def seen(frame: Registration, point: Vec) -> Vec:
    """A point (3, m) of the true arm's frame 0 in the registered one."""
    return matvec(frame.rotation, point) + frame.translation


def when(condition: Scalar, frame: Registration) -> Registration:
    """The registration where `condition`, else none: the frames are the same."""
    return where(condition, frame, _same())


def fit(arm: str, true: list[Vec]) -> Registration:
    """The registration from true tips (m) at POSES."""
    reported, solve = _normal_equations(arm)
    frame = _same()
    for _ in range(STEPS):
        residual = Vec(
            x for p, r in zip(true, reported, strict=True) for x in Vec(r) - seen(frame, p)
        )
        small = Vec(dot(Vec(row), residual) for row in solve)
        turn = mapping.matrix_from_quat(Vec((small[0] * 0.5, small[1] * 0.5, small[2] * 0.5, 1.0)))
        frame = Registration(
            matmul(turn, frame.rotation),
            matvec(turn, frame.translation) + Vec((small[3], small[4], small[5])),
        )
    return frame


def _same() -> Registration:
    zero, one = jnp.float32(0.0), jnp.float32(1.0)
    return Registration(
        matrix((one, zero, zero), (zero, one, zero), (zero, zero, one)), Vec((zero,) * 3)
    )


@functools.cache
def _normal_equations(
    arm: str,
) -> tuple[tuple[tuple[float, ...], ...], tuple[tuple[float, ...], ...]]:
    """Reported tips (m) at POSES, and the matrix [6, 3 poses] from residuals to rotation (rad)
    and displacement (m).
    """
    with at_once():  # it may be called for in a trace
        tips = np.array([kinematics.forward(arm, pose).position for pose in POSES])
    design = np.zeros((len(tips), 3, 6))
    for one, (x, y, z) in zip(design, tips, strict=True):
        one[:, :3] = [[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]]  # rotation x tip
        one[:, 3:] = np.eye(3)
    solve = np.linalg.pinv(design.reshape(-1, 6))
    return tuple(tuple(map(float, row)) for row in tips), tuple(
        tuple(map(float, row)) for row in solve
    )
