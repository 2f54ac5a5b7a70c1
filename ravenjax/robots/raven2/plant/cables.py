"""Elastic cables between capstan and joint: the authors' exponential spring-damper, linearised once
a step.

Stretch is kept in motor angle, `epsilon = m - T q` (rad), with T the motor matrix including all
cable coupling, so that zero stretch is exactly where encoders, cable coupling of the control
software and links agree. At the capstan it is `delta = a epsilon` (m) with a = capstan radius /
gearbox ratio. The tension difference is `gamma = ke (exp(delta)
- exp(-delta)) + 2 be delta'` (CSLDepend/raven2_sim, Li_DYN/two_arm_dyn.cpp). In motor coordinates it acts as `lambda
= a gamma`: on the motor as `-reaction_scale * lambda`, on the joints as `T^T lambda` (energy is conserved).
"""  # noqa: E501

from __future__ import annotations

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, record

POSITIONING_ARM = (
    5.675e-3 / 12.25
)  # a, m of cable per rad of motor; capstan of the GP42, raven2: defines.h
TOOL_ARM = 5.005e-3 / (26.0 / 7.0)  # a, m per rad; capstan of the GP32
ARMS_M = (POSITIONING_ARM,) * 3 + (TOOL_ARM,) * 4

POSITIONING_STRENGTH = 1200.0
"""N, of a new stainless wire rope of 1.19 mm (3/64 in), 7x19: 270 lbf in makers' catalogues. The
diameter is raven2's (defines.h), the construction is assumed; a worn rope, or one bent over small
pulleys, breaks earlier."""
TOOL_STRENGTH = POSITIONING_STRENGTH * (0.61 / 1.19) ** 2
"""N, of a rope of 0.61 mm (diameter: raven2, defines.h); assumed: as strong per section as the
thicker one, 315 N.
"""


@record
class Linear:
    """`lambda = force + damping * epsilon'`, for the velocity at the end of the step."""

    force: Scalar  # N m (motor coordinates) at zero stretch rate
    damping: Scalar  # N m s/rad, stiffness of the coming step included

    def carried(self, arm: float, rate: Scalar) -> Scalar:
        """What the cable carried in the step, N: stiffness and damping, at the stretch rate
        (rad/s) of its end.
        """
        return (self.force + self.damping * rate) * (1.0 / arm)


def tension(stiffness: Scalar, damping: Scalar, delta: Scalar, rate: Scalar) -> Scalar:
    """gamma (N) at stretch `delta` (m) and `rate` (m/s)."""
    return 2.0 * stiffness * _sinh(delta) + 2.0 * damping * rate


def linearise(arm: float, stiffness: Scalar, damping: Scalar, stretch: Scalar, dt: float) -> Linear:
    """Force and implicit damping over the coming `dt` (s): lever `arm` (m/rad), stretched by
    `stretch` (rad).
    """
    delta = arm * stretch
    slope = 2.0 * stiffness * _cosh(delta)
    return Linear(
        force=(2.0 * arm) * stiffness * _sinh(delta),
        damping=(arm * arm) * (dt * slope + 2.0 * damping),
    )


def resting_stretch(arm: float, stiffness: Scalar, force: Scalar) -> Scalar:
    """Stretch (rad) at which the cable at rest carries `force` (N m in motor coordinates)."""
    ratio = force / (2.0 * arm * stiffness)
    return jnp.log(ratio + jnp.sqrt(ratio * ratio + 1.0)) / arm


# Stretches stay below 1 mm (about 5e-4 m at the published faults), where exp(d) - exp(-d) loses all
# digits in
# float32; these series are exact to 1e-10 relative up to 0.1 m.
def _sinh(x: Scalar) -> Scalar:
    square = x * x
    return x * (1.0 + square * (1.0 / 6.0) * (1.0 + square * 0.05))


def _cosh(x: Scalar) -> Scalar:
    square = x * x
    return 1.0 + square * 0.5 * (1.0 + square * (1.0 / 12.0))
