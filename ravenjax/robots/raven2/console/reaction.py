"""The operator who reacts: feels the cue, needs a moment, then lifts the pedal, slows down, or
corrects by eye.

The cue that is felt is the first haptic set. What the hands then do goes the way of all that hands
do: into the console's packets, so to the robot and to the nominal model alike. An operator of
action `none` is as deaf to the cue as one without a haptic device, which makes pairs of runs: the
same fault, with the cue and without.

- 1 release: the foot leaves the pedal.
- 2 slow: the hands go on along their way at `slow_to` of their speed.
- 3 correct: the hands move the instrument back to where it was meant to be, as far as the eye can
  tell (true tip against the nominal model without what the hands did beyond the plan), by
  `correct_per_s` of the distance, at `correct_speed` at most.

Assumptions, as no source measured them on this robot: 0.25 s from the first pull to the action (an
expected touch takes 0.155 s in the laboratory, a brake 0.7 to 1.5 s; sources in
`docs/explanation/hand.md`); a correction by eye closes with a time constant of 0.2 s. The cue's
force itself moves a hand only where `ravenjax.stages.hand` is in the tick. A packet that the
network delays carries what the hands did when it was made, but for a correction, which is that of
now.
"""

from __future__ import annotations

from typing import Annotated

import numpy as np

from ravenjax.numbers.algebra import dot
from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.quantity import HOUR_MS, Quantity
from ravenjax.numbers.setup import per_arm
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, replace
from ravenjax.robots.raven2.console.operator import Deviation
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.vocabulary.reactions import CORRECT, NONE, RELEASE, SLOW

TICK_S = 1e-3
TINY_M = 1e-9  # below it there is nothing to correct


@record
class ReactionParams:
    """What a campaign may vary; the assumptions above. Nobody reacts until a campaign says so."""

    action: Annotated[  # int32, one of ACTIONS
        Scalar,
        Quantity(
            "", 0, 3, "what the operator does: 0 none, 1 release, 2 slow, 3 correct", whole=True
        ),
    ] = np.int32(NONE)
    delay_ms: Annotated[
        Scalar, Quantity("ms", 0, HOUR_MS, "from the first felt pull to the action")
    ] = 250.0
    felt_force: Annotated[
        Scalar, Quantity("device units", 0, 1e9, "weakest pull that the operator notices")
    ] = 0.0
    slow_to: Annotated[Scalar, Quantity("", 0, 1, "speed of slowed hands, of what it was")] = 0.25
    correct_per_s: Annotated[
        Scalar,
        Quantity("1/s", 0, 1e3, "share of the distance that a correcting operator takes back"),
    ] = 5.0
    correct_speed: Annotated[Scalar, Quantity("m/s", 0, 10, "fastest correction of the tip")] = 0.05


@record
class ReactionState:
    """What the operator remembers."""

    felt: Scalar  # int32, tick of the first pull that was felt in pedal-down; -1: none
    acted: Scalar  # int32, first tick of the action; -1: none
    acted_packet: Scalar  # int32, row of the motion in the first packet of the action


@record
class OperatorSenses:
    """What reaches the operator's eyes and hands; tuples have one entry an arm."""

    force: tuple[Scalar, ...]  # device units, of the first haptic set
    tip: tuple[Vec, ...]  # m, true tip
    model_tip: tuple[Vec, ...]  # m, that of the nominal model
    off_plan: tuple[
        Vec, ...
    ]  # m, frame 0, by which the hands asked for more than the plan, of both alike
    pedal_down: Scalar  # bool
    tick: Scalar  # int32


def init(setup: RavenSetup) -> ReactionState:
    """Nothing felt."""
    return ReactionState(jnp.int32(-1), jnp.int32(-1), jnp.int32(-1))


def act(
    setup: RavenSetup, params: ReactionParams, state: ReactionState, tick: Scalar, packet: Scalar
) -> ReactionState:
    """Before this tick's packet, of the motion's row `packet`: whether the action begins now."""
    waited = lax.convert_element_type(tick - state.felt, setup.precision.real) >= params.delay_ms
    begins = (params.action != NONE) & (state.felt >= 0) & waited & (state.acted < 0)
    return replace(
        state,
        acted=jnp.where(begins, tick, state.acted),
        acted_packet=jnp.where(begins, packet, state.acted_packet),
    )


def deviation(
    setup: RavenSetup, params: ReactionParams, state: ReactionState, row: Scalar, before: Scalar
) -> Deviation:
    """Foot and hands in the packet of that row of the motion, after one of row `before`."""

    def since(packet: Scalar) -> tuple[Scalar, Scalar]:
        rows = packet - state.acted_packet
        return rows, (state.acted >= 0) & (rows >= 0)

    def lag(packet: Scalar) -> Scalar:
        rows, acting = since(packet)
        behind = lax.convert_element_type(rows, setup.precision.real) * (1.0 - params.slow_to)
        return jnp.where(acting & (params.action == SLOW), as_int(behind), 0)

    released = since(row)[1] & (params.action == RELEASE)
    return Deviation(lag(row), lag(before), lifted=released)


def feel(
    setup: RavenSetup, params: ReactionParams, state: ReactionState, felt: OperatorSenses
) -> tuple[ReactionState, tuple[Vec, ...]]:
    """After this tick's cue: the state, and by how much the hands take each tip along to
    correct, m in frame 0.
    """
    noticed = felt.force[0] > params.felt_force
    for force in felt.force[1:]:
        noticed = noticed | (force > params.felt_force)
    correcting = (state.acted >= 0) & (params.action == CORRECT) & felt.pedal_down

    def corrected(i: int) -> Vec:
        wanted = felt.model_tip[i] - felt.off_plan[i] - felt.tip[i]
        distance = jnp.sqrt(dot(wanted, wanted))
        speed = jnp.minimum(distance * params.correct_per_s, params.correct_speed)
        share = jnp.where(correcting, speed * TICK_S / jnp.maximum(distance, TINY_M), 0.0)
        return wanted * share

    first = noticed & felt.pedal_down & (state.felt < 0)
    return replace(state, felt=jnp.where(first, felt.tick, state.felt)), per_arm(
        setup, lambda i, _: corrected(i)
    )
