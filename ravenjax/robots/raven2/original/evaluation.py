"""Which order of operations the control software's geometry is evaluated in: the one place that
decides.

There are two writings of each function. The one that nearly everything uses shares work and folds
constants; it is an order of magnitude cheaper, and as exact. The other repeats the original
operation for operation, and is only of use where results are rounded as the original rounds them:
float32 stored, float64 evaluated. `ORIGINAL` precision is that.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial, reduce
from typing import NamedTuple

from ravenjax.numbers.algebra import add, matvec, mul, scale, sub
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec
from ravenjax.robots.raven2.geometry import gravity, kinematics, mapping
from ravenjax.robots.raven2.geometry.gravity import CENTRES, GRAVITY_AS_STORED, MASSES
from ravenjax.robots.raven2.geometry.joints import Pose, yaw
from ravenjax.robots.raven2.geometry.transmission import GP42
from ravenjax.robots.raven2.original import constants as stored
from ravenjax.robots.raven2.original import kinematics as original_kinematics
from ravenjax.robots.raven2.original import transforms
from ravenjax.robots.raven2.original.kinematics import link1, link2, link3, thetas
from ravenjax.robots.raven2.original.transforms import apply, inverse_matrix
from ravenjax.robots.raven2.setup import RavenSetup


def gravity_torque(arm: str, jpos: Vec) -> Vec:
    """tau_g: capstan torque (3, Nm) of the compensating joint efforts, as `gravity.gravity_torque`
    under the float32 gravity that the original holds.

    The operations are those of raven2 `src/raven/grav_comp.cpp`, in their order. Rotations are
    inverted by cofactors. Transmission ratios are the float32 numbers to which `defines.h` casts
    them.
    """
    theta1, theta2, d3, *_ = thetas(arm, Vec((*jpos[:5], yaw(jpos))))
    t01, t12, t23 = link1(arm, theta1), link2(jnp.cos(theta2), jnp.sin(theta2)), link3(arm, d3)

    centres, (_, m2, m3) = CENTRES[arm], MASSES
    com2, com3 = Vec(centres.link2), t23.origin  # in frame 2
    in_frame1 = (Vec(centres.link1), apply(t12, com2), apply(t12, com3))

    g1 = matvec(inverse_matrix(t01.rotation), Vec((-GRAVITY_AS_STORED, 0.0, 0.0)))
    g2 = matvec(inverse_matrix(t12.rotation), g1)
    g3 = matvec(inverse_matrix(t23.rotation), g2)

    shoulder = reduce(
        add, (_about_z(com, scale(m, g1)) for com, m in zip(in_frame1, MASSES, strict=True))
    )
    elbow = add(_about_z(com2, scale(m2, g2)), _about_z(com3, scale(m3, g2)))
    efforts = Vec((shoulder, elbow, m3 * g3[2]))
    return efforts.map(lambda effort, ratio: -effort / ratio * GP42, stored.TR[:3])


def _about_z(centre: Vec, weight: Vec) -> Scalar:
    return sub(mul(centre[0], weight[1]), mul(centre[1], weight[0]))


class Evaluation(NamedTuple):
    """One writing of the geometry; contracts as in `kinematics`, `gravity` and `mapping`."""

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
    original_kinematics.forward,
    original_kinematics.inverse,
    gravity_torque,
    transforms.quat_from_matrix,
)


def evaluation(setup: RavenSetup) -> Evaluation:
    """LITERAL where the widths are the original's, else SHARING."""
    precision = setup.precision
    return LITERAL if (precision.narrow, precision.wide) == ("float32", "float64") else SHARING
