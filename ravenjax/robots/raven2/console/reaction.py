"""Models an operator who releases the pedal, slows down or corrects, some time after the cue.

The operator feels the first haptic set. The resulting motion of the hands goes into the console's
packets, and so to the robot and to the nominal model alike. With action `none` the operator ignores
the cue; pairs of runs compare this with an action.

- 1 release: the foot leaves the pedal.
- 2 slow: the hands continue along their path at `slow_to` of their speed.
- 3 correct: the hands move the instrument back to the intended position. This position is the
  nominal model's tip without the motion of the hands beyond the plan. The operator sees how far the
  true tip is from it. The correction reduces it by `correct_per_s`, at most at `correct_speed`.

No source measured reactions on this robot. It is *assumed* that the action follows the first pull
after 0.25 s, and that a correction by eye has a time constant of 0.2 s (docs/explanation/hand.md
has sources of reaction times). A packet that the network delays carries the hands' motion at the
time when it was made, except a correction, which is the present one.
"""

from functools import reduce
from operator import or_

import numpy as np

from ravenjax.numbers import describe_fields, jnp, lax, per_arm
from ravenjax.numbers.algebra import norm
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, replace
from ravenjax.robots.raven2.console.operator import Deviation
from ravenjax.robots.raven2.setup import ArmName, PerArm, RavenSetup
from ravenjax.vocabulary.reactions import CORRECT, NONE, RELEASE, SLOW

TICK_S = 1e-3
# m; a smaller distance is not corrected
TINY_M = 1e-9


@describe_fields
@record
class ReactionParams:
    """Parameters of the reaction. The defaults are assumed, and have no action."""

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
    off_plan: PerArm[Vec]  # m, frame 0, tip motion commanded by the hands in addition to the plan
    pedal_down: Scalar  # bool
    tick: Scalar  # int32


def init() -> ReactionState:
    """Return the state before any pull."""
    return ReactionState(*(jnp.int32(-1),) * 3)


def react_to_cue(
    setup: RavenSetup, params: ReactionParams, state: ReactionState, tick: Scalar, packet: Scalar
) -> ReactionState:
    """Return the state after the decision whether the action begins in this tick.

    packet: row of the motion in this tick's packet, int32.
    """
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
    """Return the deviations of foot and hands in a packet.

    row, before: rows of the motion in this packet and in the packet before, int32.
    """

    def since(packet: Scalar):
        rows = packet - state.acted_packet
        return rows, (state.acted >= 0) & (rows >= 0)

    def lag(packet: Scalar):
        rows, is_acting = since(packet)
        rows_behind = lax.convert_element_type(rows, setup.precision.real) * (1.0 - params.slow_to)
        return jnp.where(is_acting & (params.action == SLOW), as_int(rows_behind), 0)

    released = since(row)[1] & (params.action == RELEASE)
    return Deviation(lag(row), lag(before), lifted=released)


def feel_cue(
    setup: RavenSetup, params: ReactionParams, state: ReactionState, senses: OperatorSenses
) -> tuple[ReactionState, PerArm[Vec]]:
    """Return the state after this tick's cue, and the correction of each tip, m in frame 0."""
    pull_is_felt = reduce(or_, (force > params.felt_force for force in senses.force))
    correcting = (state.acted >= 0) & (params.action == CORRECT) & senses.pedal_down

    def corrected(i: int, _: ArmName):
        # Returns the motion of one tip in this tick that reduces its distance, m.
        error = senses.model_tip[i] - senses.off_plan[i] - senses.tip[i]
        distance = norm(error)
        speed = jnp.minimum(distance * params.correct_per_s, params.correct_speed)
        share = jnp.where(correcting, speed * TICK_S / jnp.maximum(distance, TINY_M), 0.0)
        return error * share

    first = pull_is_felt & senses.pedal_down & (state.felt < 0)
    state = replace(state, felt=jnp.where(first, senses.tick, state.felt))
    return state, per_arm(setup, corrected)
