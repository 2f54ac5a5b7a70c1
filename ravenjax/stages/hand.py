"""Models the operator's hand as a mass on spring and damper that the cue's force displaces.

    M d'' + B d' + K d = F        d: displacement of the hand; three axes with the same M, B, K

The planned motion of the hand does not depend on the cue. The console sends the plan plus d. The
spring is the posture that muscles hold. A stretched muscle responds after 25 to 100 ms (PLoS ONE
11(10):e0163854, 2016), sooner than any reaction. Measurements of a hand's stiffness take longer
than this, so their values include the response.

The mass and friction of the device are neglected. quantities.toml has the sources of the numbers.

The equation is discretised by the implicit midpoint rule, which is stable for any parameters. Over
a tick of length h, with u the mean of the velocities before and after, it gives exactly

    change of (M v^2 + K d^2) / 2  =  F . (change of d) - h B u^2

The hand therefore never returns more energy than the force put in.
"""

import math
from collections.abc import Sequence

import numpy as np

from ravenjax.numbers import Scalar, Setup, Vec, cast_to_real, describe_fields, jnp, largest, record
from ravenjax.numbers.algebra import norm
from ravenjax.vocabulary import TICK_S


@describe_fields
@record
class HandParams:
    """Parameters of the hand that a campaign may vary; the default is a hand at half grip."""

    grip: Scalar = 0.5
    newtons_per_unit: Scalar = 3.3  # negative: pushes away from the model, for null models
    mass: Scalar = 0.554
    damping: Scalar = 6.45
    stiffness: Scalar = 135.0
    firm_times: Scalar = 5.0
    turn_deg: Scalar = 0.0


@record
class HandState:
    """Displacement of one hand from its plan."""

    displacement: Vec  # m, axes of the console
    velocity: Vec  # m/s
    peak: Scalar  # m, largest displacement so far


def init(setup: Setup) -> HandState:
    """Return the state of a hand that rests on its plan."""
    zeros = cast_to_real(setup, Vec.full(3, 0.0))
    return HandState(displacement=zeros, velocity=zeros, peak=cast_to_real(setup, 0.0))


def step(setup: Setup, params: HandParams, state: HandState, pull: Vec) -> HandState:
    """Return the state of the hand after a tick in which the cue pulls with the force `pull` (3,
    device units). A NaN force counts as 0.
    """
    stiffness, damping = hand_impedance(params)
    # NaN is not equal to itself.
    pull = pull.map(lambda x: jnp.where(x == x, x, 0.0))
    force = turn_force(pull, params.turn_deg) * params.newtons_per_unit
    # Implicit midpoint rule M (v' - v) / h + B u + K (d + h u / 2) = F, solved for the mean
    # u = (v + v') / 2. v, v': velocities before and after the tick; d: displacement before it.
    mass_rate = 2.0 * params.mass / TICK_S
    total_force = force + state.velocity * mass_rate - state.displacement * stiffness
    mean_velocity = total_force * (1.0 / (mass_rate + damping + 0.5 * TICK_S * stiffness))
    displacement = state.displacement + mean_velocity * TICK_S
    peak = jnp.maximum(state.peak, norm(displacement))
    return cast_to_real(setup, HandState(displacement, mean_velocity * 2.0 - state.velocity, peak))


def hand_impedance(params: HandParams) -> tuple[Scalar, Scalar]:
    """Return stiffness (N/m) and damping (N s/m) at the hand's grip: 0 is relaxed, 1 is firm."""
    factor = 1.0 + params.grip * (params.firm_times - 1.0)
    return params.stiffness * factor, params.damping * jnp.sqrt(factor)


def turn_force(force: Vec, angle_deg: Scalar) -> Vec:
    """Return a force (x, y, z) rotated by an angle about (1, 1, 1); 120 degrees move x to y."""
    # Without a rotation, the compiled tick has no operation for it.
    if isinstance(angle_deg, float | np.floating) and angle_deg == 0.0:
        return force
    angle = angle_deg * (math.pi / 180.0)
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    # Rodrigues' formula, n = (1, 1, 1) / sqrt 3: F cos + (n x F) sin + n (n . F) (1 - cos).
    parallel = (force[0] + force[1] + force[2]) * ((1.0 - cos) / 3.0)
    perpendicular = Vec((force[2] - force[1], force[0] - force[2], force[1] - force[0])) * (
        sin / math.sqrt(3.0)
    )
    return force * cos + perpendicular + parallel


def outcomes(setup: Setup, arms: Sequence[HandState]) -> dict[str, Scalar]:
    """Return the outcome column `hand_mm`: the largest displacement of any arm's hand, mm."""
    return {"hand_mm": largest(arm.peak for arm in arms) * 1e3}
