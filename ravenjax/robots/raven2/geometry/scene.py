"""Where the instrument tips are in the operating scene: the arms' places, the tissue below them, each other.

The world's z axis points up. The arms' frames are read from the model; the tissue is the dome of its phantom, without
the folds (up to 2 mm) and the rounded rim that make the mesh look soft.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from ravenjax.numbers.algebra import matvec, minus, plus
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.dynamics import arm_model

TISSUE_TOP = 0.182  # m, height of the dome; models/raven2 PROVENANCE.md
TISSUE_SAG = (0.012 / 0.085**2, 0.7 * 0.012 / 0.07**2)  # 1/m, curvature of the dome along x and y
TISSUE_HALF = (0.075, 0.060)  # m, half its extent along x and y


@cache
def frame0(arm: ArmName) -> tuple[Vec, Vec]:
    """Origin (m) and rotation rows of the arm's frame 0 in the world, Python numbers, literal zeros and ones."""
    model = arm_model.scene()
    body = model.body(arm_model.base(arm))
    rows = _rows(*(body.quat / np.linalg.norm(body.quat)).tolist())
    exact = [[float(round(x)) if abs(x - round(x)) < 1e-12 else float(x) for x in row] for row in rows]
    return Vec(float(x) for x in body.pos), Vec(map(Vec, exact))


def _rows(w: float, x: float, y: float, z: float) -> list[list[float]]:
    """The rotation matrix of a unit quaternion, as SciPy computes it, whose import takes longer than all of a trace."""
    return [
        [x * x - y * y - z * z + w * w, 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), -x * x + y * y - z * z + w * w, 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), -x * x - y * y + z * z + w * w],
    ]


def base_pose(arm: ArmName) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """The arm's frame 0 in the world: origin x, y, z (m) and unit quaternion x, y, z, w."""
    body = arm_model.scene().body(arm_model.base(arm))
    (px, py, pz), (w, x, y, z) = (map(float, numbers) for numbers in (body.pos, body.quat))
    return (px, py, pz), (x, y, z, w)


def world(arm: ArmName, position: Vec) -> Vec:
    """A point of the arm's frame 0 in the world, m."""
    origin, rotation = frame0(arm)
    return plus(origin, matvec(rotation, position))


def tissue_depth(arm: ArmName, tip: Vec) -> Scalar:
    """How far `tip` (m, frame 0) is below the tissue's surface, m; negative above it, -inf beside it."""
    x, y, z = world(arm, tip)
    height = TISSUE_TOP - TISSUE_SAG[0] * (x * x) - TISSUE_SAG[1] * (y * y)
    inside = (jnp.abs(x) < TISSUE_HALF[0]) & (jnp.abs(y) < TISSUE_HALF[1])
    return jnp.where(inside, height - z, -jnp.inf)


def tip_distance(arms: tuple[ArmName, ...], tips: tuple[Vec, ...]) -> Scalar:
    """Distance of the two tips, m; infinite with one arm."""
    if len(arms) < 2:
        return jnp.asarray(jnp.inf, tips[0][0].dtype)
    apart = minus(world(arms[0], tips[0]), world(arms[1], tips[1]))
    return jnp.sqrt(apart[0] * apart[0] + apart[1] * apart[1] + apart[2] * apart[2])
