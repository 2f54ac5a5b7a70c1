"""Models the operator's hand as a mass on spring and damper that the force of the haptic cue
displaces.

    M d'' + B d' + K d = F        d: displacement of the hand; three axes, all alike

The hand follows its plan as without a cue. The console sends the plan plus d. The
spring is the posture that muscles hold. A stretched muscle answers after 25 to 100 ms (PLoS ONE
11(10):e0163854, 2016), sooner than any reaction. A measured spring therefore includes these
answers.

- Relaxed, M 0.554 kg, B 6.45 N s/m, K 135 N/m. They are fitted to one trial of one participant who
  held the handle of a haptic device (van Beek, Bergmann Tiest, Mugge, Kappers, Scientific Reports
  5:18004, 2015, Figure 3).
- A firmer grip makes a hand stiffer and more damped. Hasser, Cutkosky (Haptic Interfaces 2002)
  measured a pinched knob. Fu, Cavusoglu (IEEE SMC-B 42, 2012) give models of a held stylus by grip
  force. By how much is *assumed*: at a firm grip five times the stiffness (range 2 to 10), with the
  same damping ratio.
- Newtons per device unit of the cue: no source states it. *Assumed*: 3.3, the largest force of a
  Phantom Omni, which is one of the Raven's masters (range 1 to 66; with 66 the published cap of
  0.05 units is that largest force).
- The device's own mass and friction are neglected.

The equation is discretised by the implicit midpoint rule, which is stable for any parameters. Over
a tick of length h, with u the mean of the velocities before and after, it gives exactly

    change of (M v^2 + K d^2) / 2  =  F . (change of d) - h B u^2

The hand therefore never gives back more energy than the force put in.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np

from ravenjax.numbers.algebra import norm
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.quantity import Quantity
from ravenjax.numbers.setup import Setup, cast_to_real
from ravenjax.numbers.vec import Scalar, Vec, largest, record

TICK_S = 1e-3


@record
class HandParams:
    """Hand parameters that a campaign may vary; the default is the hand above at grip 0.5."""

    grip: Annotated[
        Scalar, Quantity("", 0, 1, "how firmly the hand holds the console: 0 relaxed, 1 firm")
    ] = 0.5
    newtons_per_unit: Annotated[  # negative: pushes away from the model, for null models
        Scalar,
        Quantity("N", -1e3, 1e3, "force on the hand per device unit of the first haptic set"),
    ] = 3.3
    mass: Annotated[
        Scalar, Quantity("kg", 0.01, 10, "mass of the hand that the cue's force moves")
    ] = 0.554
    damping: Annotated[Scalar, Quantity("N s/m", 0, 1e3, "damping of a relaxed hand")] = 6.45
    stiffness: Annotated[Scalar, Quantity("N/m", 0, 1e5, "stiffness of a relaxed hand")] = 135.0
    firm_times: Annotated[
        Scalar,
        Quantity(
            "", 1, 100, "stiffness of a firm hand by that of a relaxed one; the damping ratio stays"
        ),
    ] = 5.0
    turn_deg: Annotated[
        Scalar,
        Quantity(
            "deg",
            -180,
            180,
            "turn of the force about the diagonal of the console's axes: a null model",
        ),
    ] = 0.0


@record
class HandState:
    """Displacement of one hand from its plan."""

    displacement: Vec  # m, axes of the console
    velocity: Vec  # m/s
    peak: Scalar  # m, largest displacement so far


def init(setup: Setup) -> HandState:
    """Return the state of a hand on its plan."""
    still = cast_to_real(setup, Vec.full(3, 0.0))
    return HandState(still, still, cast_to_real(setup, 0.0))


def step(setup: Setup, params: HandParams, state: HandState, pull: Vec) -> HandState:
    """Return the hand after a tick of the cue's force `pull` (3, device units); NaN counts as 0."""
    stiffness, damping = hand_impedance(params)
    pull = pull.map(lambda x: jnp.where(x == x, x, 0.0))
    force = turn_force(pull, params.turn_deg) * params.newtons_per_unit
    momentum = 2.0 * params.mass / TICK_S
    mean = force + state.velocity * momentum - state.displacement * stiffness
    mean = mean * (1.0 / (momentum + damping + 0.5 * TICK_S * stiffness))
    displacement = state.displacement + mean * TICK_S
    peak = jnp.maximum(state.peak, norm(displacement))
    after = HandState(displacement, mean * 2.0 - state.velocity, peak)
    return cast_to_real(setup, after)


def hand_impedance(params: HandParams) -> tuple[Scalar, Scalar]:
    """Return stiffness (N/m) and damping (N s/m) at the hand's grip."""
    times = 1.0 + params.grip * (params.firm_times - 1.0)
    return params.stiffness * times, params.damping * jnp.sqrt(times)


def turn_force(force: Vec, angle_deg: Scalar) -> Vec:
    """Return a force (x, y, z) turned about (1, 1, 1) by an angle; 120 degrees turn x into y."""
    if isinstance(angle_deg, float | np.floating) and angle_deg == 0.0:
        return force
    angle = angle_deg * (math.pi / 180.0)
    cos, sin = jnp.cos(angle), jnp.sin(angle)
    along = (force[0] + force[1] + force[2]) * ((1.0 - cos) / 3.0)
    across = Vec((force[2] - force[1], force[0] - force[2], force[1] - force[0])) * (
        sin / math.sqrt(3.0)
    )
    return force * cos + across + along


def outcomes(setup: Setup, arms: Sequence[HandState]) -> dict[str, Scalar]:
    """Return the largest displacement of a hand, the worse of the arms, as an outcome column."""
    return {"hand_mm": largest(arm.peak for arm in arms) * 1e3}
