"""Models an operator who releases the pedal, slows down or corrects, some time after the cue.

The operator feels the force of the first haptic set. The resulting motion of the hands goes into
the console's packets, and so to the robot and to the nominal model alike. With action `none` the
operator ignores the cue. A campaign can run the same fault with and without an action.

- 1 release: the foot leaves the pedal.
- 2 slow: the hands continue along their path at `slow_to` of their speed.
- 3 correct: the hands move the instrument back to the intended position, which is where the tip of
  the nominal model would be if the hands had kept to the plan. The operator sees the distance of
  the true tip from this position. The correction reduces the distance by the share `correct_per_s`
  per second, with at most the speed `correct_speed`.

No source measured reactions on this robot. It is *assumed* that the action follows the first cue
after 0.25 s, and that a correction by eye has a time constant of 0.2 s (docs/explanation/hand.md
has sources of reaction times). A packet that the network delays carries the hands' motion of the
time when it was sent. A correction in this packet is that of the time when the packet arrives.
"""

from functools import reduce
from operator import or_

import numpy as np

from ravenjax.numbers import describe_fields, jnp, lax
from ravenjax.numbers.algebra import norm
from ravenjax.numbers.vec import Scalar, Vec, as_int, first_tick, record, replace
from ravenjax.robots.raven2.console.operator import Deviation
from ravenjax.robots.raven2.setup import PerArm, RavenSetup
from ravenjax.vocabulary import TICK_S
from ravenjax.vocabulary.reactions import CORRECT, NONE, RELEASE, SLOW

# m; keeps a division by the distance finite
MIN_DISTANCE_M = 1e-9


@describe_fields
@record
class ReactionParams:
    """Parameters of the reaction. The defaults are assumed; the default action is `none`."""

    action: Scalar = np.int32(NONE)  # int32, one of ACTIONS
    delay_ms: Scalar = 250.0
    felt_force: Scalar = 0.0
    slow_to: Scalar = 0.25
    correct_per_s: Scalar = 5.0
    correct_speed: Scalar = 0.05


@record
class ReactionState:
    """The state of the operator's reaction."""

    felt: Scalar  # int32, tick of the first pull that was felt in pedal-down; -1: none
    acted: Scalar  # int32, first tick of the action; -1: none
    acted_packet: Scalar  # int32, row of the motion in the first packet of the action


@record
class OperatorSenses:
    """What the operator sees and feels."""

    force: PerArm[Scalar]  # device units, of the first haptic set
    tip: PerArm[Vec]  # m, true tip
    model_tip: PerArm[Vec]  # m, tip of the nominal model
    off_plan: PerArm[Vec]  # m, frame 0, deviation of the tips that the hands add to the plan
    pedal_down: Scalar  # bool
    tick: Scalar  # int32


def init() -> ReactionState:
    """Return the state before any pull."""
    never = jnp.int32(-1)
    return ReactionState(felt=never, acted=never, acted_packet=never)


def react_to_cue(
    setup: RavenSetup, params: ReactionParams, state: ReactionState, tick: Scalar, packet: Scalar
) -> ReactionState:
    """Return the state after the decision whether the action begins in this tick.
    packet: row of the motion in this tick's packet, int32.
    """
    # A tick is 1 ms
    since_felt = lax.convert_element_type(tick - state.felt, setup.precision.real)
    delay_over = since_felt >= params.delay_ms
    begins = (params.action != NONE) & (state.felt >= 0) & delay_over & (state.acted < 0)
    return replace(
        state,
        acted=jnp.where(begins, tick, state.acted),
        acted_packet=jnp.where(begins, packet, state.acted_packet),
    )


def packet_deviation(
    setup: RavenSetup, params: ReactionParams, state: ReactionState, row: Scalar, before: Scalar
) -> Deviation:
    """Return how foot and hands deviate from the plan in a packet: a lifted pedal, or a lag.
    row, before: rows of the motion in this packet and in the packet before, int32. In `state`,
    `acted` is a tick or -1, and `acted_packet` is a row.
    """

    def since_action(packet_row: Scalar):
        # Returns the number of rows since the action began, and whether it has begun.
        rows = packet_row - state.acted_packet
        return rows, (state.acted >= 0) & (rows >= 0)

    def lag(packet_row: Scalar):
        # Returns the number of rows by which slowed hands are behind the plan.
        rows, acts = since_action(packet_row)
        rows_behind = lax.convert_element_type(rows, setup.precision.real) * (1.0 - params.slow_to)
        return jnp.where(acts & (params.action == SLOW), as_int(rows_behind), 0)

    _, acts = since_action(row)
    lifted = acts & (params.action == RELEASE)
    return Deviation(lag(row), lag(before), lifted=lifted)


def feel_cue(
    params: ReactionParams, state: ReactionState, senses: OperatorSenses
) -> tuple[ReactionState, PerArm[Vec]]:
    """Return the state after this tick's cue, and the correcting motion of each tip, m, frame 0.
    The first pull in pedal-down starts the delay of the reaction.
    """
    pull_is_felt = reduce(or_, (force > params.felt_force for force in senses.force))
    correcting = (state.acted >= 0) & (params.action == CORRECT) & senses.pedal_down

    def correction(tip: Vec, model_tip: Vec, off_plan: Vec) -> Vec:
        # Returns the motion of one tip in this tick that brings it nearer to the planned place, m.
        # The nominal model follows the hands, which have moved its tip off the plan by `off_plan`
        error = model_tip - off_plan - tip
        distance = norm(error)
        speed = jnp.minimum(distance * params.correct_per_s, params.correct_speed)
        share = jnp.where(correcting, speed * TICK_S / jnp.maximum(distance, MIN_DISTANCE_M), 0.0)
        return error * share

    felt = first_tick(senses.tick, pull_is_felt & senses.pedal_down, state.felt)
    state = replace(state, felt=felt)
    return state, tuple(map(correction, senses.tip, senses.model_tip, senses.off_plan))
