"""Selects the order of operations in which the control software's geometry is evaluated.

Each function has two implementations. The one that nearly everything uses shares work and folds
constants; it is an order of magnitude cheaper, and as exact. The other repeats the original
operation for operation. It is only useful if results are rounded as the original rounds them:
float32 stored, float64 evaluated, which is precision `ORIGINAL`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

from ravenjax.numbers.vec import Scalar, Vec
from ravenjax.robots.raven2.geometry import gravity, kinematics, mapping
from ravenjax.robots.raven2.geometry.joints import Pose
from ravenjax.robots.raven2.original import literal
from ravenjax.robots.raven2.setup import RavenSetup


class Evaluation(NamedTuple):
    """One implementation of the geometry; contracts as in `kinematics`, `gravity` and `mapping`."""

    forward: Callable[[str, Vec, Scalar], Pose]
    inverse: Callable[[str, Pose, Scalar, Vec], kinematics.IK]
    gravity_torque: Callable[[str, Vec], Vec]
    quat_from_matrix: Callable[[Vec], Vec]


SHARING = Evaluation(
    kinematics.forward,
    kinematics.inverse,
    partial(gravity.gravity_torque, gravity=gravity.GRAVITY_AS_STORED),
    mapping.quat_from_matrix,
)
LITERAL = Evaluation(
    literal.forward,
    literal.inverse,
    literal.gravity_torque,
    literal.quat_from_matrix,
)


def evaluation(setup: RavenSetup) -> Evaluation:
    """Return LITERAL if the number widths are the original's, else SHARING."""
    precision = setup.precision
    return LITERAL if (precision.narrow, precision.wide) == ("float32", "float64") else SHARING
