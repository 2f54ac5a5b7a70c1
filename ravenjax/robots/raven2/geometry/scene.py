"""The operating scene: where the arms are, and how near tips are to tissue and to each other.

The world's z axis points up. The arms' frames are read from the model. The surface of the tissue is
a dome, on which the trunk of the vessel is a ridge. Pictures of the scene also show folds (up to
2 mm), a rounded rim, a branch of the vessel and a vein, which are not part of the surface.
"""

import itertools
from functools import cache
from typing import NamedTuple

from ravenjax import resources
from ravenjax.numbers import Scalar, Vec, jnp
from ravenjax.numbers.algebra import matvec, minus, norm, plus, transpose
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.dynamics import arm_model

TISSUE_TOP = 0.182  # m, height of the dome; models/raven2 PROVENANCE.md
TISSUE_SAG = (0.012 / 0.085**2, 0.7 * 0.012 / 0.07**2)  # 1/m, fall of the dome per x^2 and y^2
TISSUE_HALF = (0.075, 0.060)  # m, half of the tissue's extent along x and y
VESSEL_RADIUS = 0.0031  # m, radius of the trunk in models/raven2
VESSEL_HEIGHT = 0.0027  # m, height of its ridge above the dome; its axis is 0.4 mm below it
VESSEL_COURSE = resources.read_tables(__file__, "scene.toml")["vessel_course_m"]
"""m, x and y of points of the vessel's axis; the drawn vessel is a smooth curve through them."""
VESSEL_LEAN = 1.0 / (1.0 + (0.046 / 0.146) ** 2)
"""Squared ratio of the distance from the vessel's axis to that along y, for its mean slope."""


class Surface(NamedTuple):
    """The tissue's surface below or above a point."""

    depth: Scalar  # m, depth of the point below the surface, along the world's z; negative above it
    # Normal (-dh/dx, -dh/dy, 1) of the surface of height h, in the arm's frame 0
    rise: Vec
    vessel: Scalar  # bool, the vessel is below or above the point


@cache
def frame0_in_world(arm: ArmName) -> tuple[Vec, Vec]:
    """Return origin (m) and rotation rows of the arm's frame 0 in the world, as Python numbers."""
    rotation = []
    for row in arm_model.frame_rotation(arm).tolist():
        # Entries that differ from 0, 1 or -1 by rounding only become exact, and cost no operation
        rotation.append(Vec(float(round(x)) if abs(x - round(x)) < 1e-12 else x for x in row))
    return Vec(base_pose(arm)[0]), Vec(rotation)


def base_pose(arm: ArmName) -> tuple[tuple[float, float, float], tuple[float, float, float, float]]:
    """Return the arm's frame 0 in the world: origin x, y, z (m) and unit quaternion x, y, z, w."""
    body = arm_model.operating_scene().body(arm_model.base_body(arm))
    (px, py, pz), (w, x, y, z) = (map(float, numbers) for numbers in (body.pos, body.quat))
    return (px, py, pz), (x, y, z, w)


def to_world(arm: ArmName, position: Vec) -> Vec:
    """Return a point of the arm's frame 0 in the world, m."""
    origin, rotation = frame0_in_world(arm)
    return plus(origin, matvec(rotation, position))


def tissue_depth(arm: ArmName, tip: Vec) -> Scalar:
    """Return the depth of `tip` (m, frame 0) below the dome, m; -inf beside the tissue."""
    x, y, z = to_world(arm, tip)
    return jnp.where(_is_over_tissue(x, y), _dome_height(x, y) - z, -jnp.inf)


def tissue_surface(arm: ArmName, point: Vec) -> Surface:
    """Return the tissue's surface at a point (3, m, frame 0): the dome with the vessel's ridge.
    Beside the tissue the depth is -1 m. At the distance d from the axis of the vessel, the height
    of the ridge is VESSEL_HEIGHT (1 - (d/VESSEL_RADIUS)^2)^2.
    """
    x, y, z = to_world(arm, point)
    axis_y, slope = _vessel_axis(x)
    # d^2 is VESSEL_LEAN offset^2. The derivative of `offset` by x is -slope
    offset, scale = y - axis_y, VESSEL_LEAN / VESSEL_RADIUS**2
    profile = jnp.maximum(1.0 - scale * (offset * offset), 0.0)
    ridge_slope = (4.0 * VESSEL_HEIGHT * scale) * (profile * offset)  # -dh/dy of the ridge
    depth = _dome_height(x, y) + VESSEL_HEIGHT * (profile * profile) - z
    rise_x = 2.0 * TISSUE_SAG[0] * x - ridge_slope * slope
    # The normal (-dh/dx, -dh/dy, 1) of the surface of height h
    rise = Vec((rise_x, 2.0 * TISSUE_SAG[1] * y + ridge_slope, 1.0))
    _, rotation = frame0_in_world(arm)
    depth = jnp.where(_is_over_tissue(x, y), depth, -1.0)
    return Surface(depth, matvec(transpose(rotation), rise), profile > 0.0)


def _is_over_tissue(x: Scalar, y: Scalar) -> Scalar:
    return (jnp.abs(x) < TISSUE_HALF[0]) & (jnp.abs(y) < TISSUE_HALF[1])


def _dome_height(x: Scalar, y: Scalar) -> Scalar:
    # Returns z of the dome at a point of the world, m.
    return TISSUE_TOP - TISSUE_SAG[0] * (x * x) - TISSUE_SAG[1] * (y * y)


def _vessel_axis(x: Scalar) -> tuple[Scalar, Scalar]:
    # Returns y of the vessel's axis at x, m, and its slope dy/dx there.
    ends = itertools.pairwise(VESSEL_COURSE)
    pieces = [(x0, y0, (y1 - y0) / (x1 - x0)) for (x0, y0), (x1, y1) in ends]
    x0, y0, slope_before = pieces[0]
    axis_y, slope = y0 + slope_before * (x - x0), slope_before
    # The axis is a polygon: each later piece adds its change of the slope from its first point on
    for x0, _, slope_after in pieces[1:]:
        axis_y = axis_y + (slope_after - slope_before) * jnp.maximum(x - x0, 0.0)
        slope = slope + jnp.where(x > x0, slope_after - slope_before, 0.0)
        slope_before = slope_after
    return axis_y, slope


def tip_distance(arms: tuple[ArmName, ...], tips: tuple[Vec, ...]) -> Scalar:
    """Return the distance of the two tips, m; infinite with one arm."""
    if len(arms) < 2:
        return jnp.asarray(jnp.inf, tips[0][0].dtype)
    return norm(minus(to_world(arms[0], tips[0]), to_world(arms[1], tips[1])))
