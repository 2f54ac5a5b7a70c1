"""Compares a run with its golden run, number by number, to find where and when a fault first shows.

This module is a `Loop` of `ravenjax.engines.interface`. In each tick it computes the robot's loop,
and then compares every number at a seam with the golden run's number of the same tick. The numbers
of the golden run were computed before, and are read from a time series. Engines can therefore run
many lanes at once, and start them from checkpoints of golden runs. The outcomes of the robot's loop
do not change by a single bit. For each number, the comparison finds two ticks:

- `differs`: the first tick in which any bit differs from the golden run's number.
- `leaves`: the first tick in which the number is outside its normal range while the golden run's
  number is inside.

Some seams have numbers only in some ticks, as the packet in ticks in which one arrives. Such a seam
is compared only while its flag is not 0. `Seam.present` is the path of the flag. A path, such as
`control.arms.ARM.tau_d`, begins with the name of a signal.

The state of the robot's loop must have a field `monitor`, and the loop two more functions:

    name_signals(setup, signals) -> {name of a signal: numbers of the signal}
    check_histories(setup, state) -> {name of a check: `stages.check.CheckHistory`}
"""

import dataclasses
from typing import Any

from ravenjax.faults import fault
from ravenjax.faults.injection import read_channel
from ravenjax.numbers import Scalar, Setup, cast_to_real, first_tick, jnp, lax, record
from ravenjax.numbers.setup import Compared, Explained, inner_loop
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.seams import (
    DIFFERS,
    GOLDEN_NEAR,
    LEAVES,
    NEAR,
    NEAR_MS,
    Crossing,
    list_crossings,
)
from ravenjax.vocabulary.sites import ARM

HARM = "harm_ms"
"""Outcome: first tick in which any hazard of the motion was beyond its limit; -1: never."""
ROUNDED = 5e-6
"""Relative margin of both ends of a normal range, which may be rounded to six digits."""


@record
class NumberHistory:
    """History of one number that crosses a seam."""

    differs: Scalar  # int32, first tick in which it differs from the golden run's; -1: never
    # int32, first tick outside its normal range while the golden run's is inside; None: no range
    leaves: Scalar | None


@record
class MarginHistory:
    """History of one check, until harm."""

    margin: Scalar  # smallest distance to the limit, as in `stages.check`
    golden: Scalar  # smallest distance of the golden run until the same tick
    tick: Scalar  # int32, tick of the smallest distance; -1: nothing was measured


@record
class ExplainedState:
    """A run's state, and the state of the observer."""

    tick: Any  # of the robot's loop
    numbers: tuple[NumberHistory, ...]  # in the order of `Explained.numbers`
    margins: tuple[MarginHistory, ...]  # in the order of `check_histories`
    harm: Scalar  # int32, tick of the first harm; -1: none


def explain_program(program: Any, robot: Robot) -> Any:
    """Return a program of the same runs, each compared with its golden run at the robot's seams.
    robot: with the users' checks of the campaign.
    """
    setup = program.setup

    def compared(crossing: Crossing) -> Compared:
        channel, arm = crossing.channel, crossing.arm
        # In the path of a channel, ARM stands for the index of the arm.
        path = (setup.arms.index(arm) if step == ARM else step for step in channel.path)
        # The normal range, extended by the rounding of its ends; None: no normal range.
        normal = robot.normal_range(channel.site, channel.name, arm)
        span = normal and (
            normal.low - ROUNDED * abs(normal.low),
            normal.high + ROUNDED * abs(normal.high),
        )
        return Compared(crossing.name, tuple(path), crossing.seam.present, span)

    compared_numbers = tuple(map(compared, list_crossings(robot.seams, setup.arms)))
    use = Explained(len(robot.checks), compared_numbers)
    # The program runs the loop of this module, which calls the robot's loop, the inner module.
    setup = dataclasses.replace(setup, explained=use, inner=program.module)
    return dataclasses.replace(program, module=__name__, setup=setup)


def init(setup: Setup, params: Any) -> ExplainedState:
    """Return the state of the robot's loop, with no differences."""
    loop = inner_loop(setup)
    never, state = jnp.int32(-1), loop.init(setup, params)
    infinite = cast_to_real(setup, jnp.inf)
    spans = [number.span for number in _compared(setup)]
    return ExplainedState(
        tick=state,
        # None for a number without a normal range: it adds no operation to the tick.
        numbers=tuple(NumberHistory(never, None if span is None else never) for span in spans),
        margins=tuple(
            MarginHistory(infinite, infinite, never) for _ in loop.check_histories(setup, state)
        ),
        harm=never,
    )


def advance(
    setup: Setup, params, faults: fault.Faults, state: ExplainedState, now: Scalar, motion, golden
) -> tuple[ExplainedState, tuple[Scalar, ...], Any]:
    """Compute the tick `now` of the robot's loop, then compare it with the golden run.

    golden: the golden run's series in this tick: the numbers that the robot's loop stores, the
    compared numbers, and the margins of checks. Return state, series and signals of this run.
    """
    loop = inner_loop(setup)
    length = loop.series_length(setup)
    checked = length + len(state.numbers)
    after, series, signals = loop.advance(
        setup, params, faults, state.tick, now, motion, golden[:length]
    )
    numbers, stored_numbers, seams = [], [], loop.name_signals(setup, signals)
    for history, compared, golden_number in zip(
        state.numbers, _compared(setup), golden[length:checked], strict=True
    ):
        seam, *path = compared.path
        number = read_channel(seams[seam], tuple(path))
        # A seam whose flag is 0 does not exist in this tick.
        flag = compared.present
        exists = not flag or read_channel(seams[flag[0]], flag[1:]) != 0
        new_history, bits = _compare_number(
            history, compared.span, number, exists, golden_number, now
        )
        numbers.append(new_history)
        stored_numbers.append(lax.bitcast_convert_type(bits, jnp.float32))
    # A check counts only before the first harm.
    is_before_harm = state.harm < 0
    margins, margin_histories = [], []
    for before, check, golden_margin in zip(
        state.margins, loop.check_histories(setup, after).values(), golden[checked:], strict=True
    ):
        margin = cast_to_real(setup, check.margin)
        is_smallest = is_before_harm & (margin < before.margin)
        margin_histories.append(
            MarginHistory(
                margin=jnp.where(is_smallest, margin, before.margin),
                golden=jnp.where(is_before_harm, golden_margin, before.golden),
                tick=jnp.where(is_smallest, now, before.tick),
            )
        )
        margins.append(margin)
    monitor = after.monitor
    is_harmful = (monitor.unintended >= 0) | (monitor.loss >= 0) | (monitor.false_report >= 0)
    harm = jnp.where(is_harmful & is_before_harm, now, state.harm)
    explained = ExplainedState(after, tuple(numbers), tuple(margin_histories), harm)
    return explained, (*series, *stored_numbers, *margins), signals


def _compare_number(
    history: NumberHistory, span, number, exists, golden_number, now
) -> tuple[NumberHistory, Scalar]:
    # Returns the history of a number after this tick, and the bits of the number as int32. span:
    # its normal range, (low, high) or None. exists: bool, whether the seam has a number in this
    # tick. golden_number: float32 with the bits of the golden run's number.
    number = jnp.asarray(number)
    is_float = number.dtype == jnp.float32
    # Numbers are compared bit by bit. Whole numbers and truth values become int32.
    to_bits = lax.bitcast_convert_type if is_float else lax.convert_element_type
    bits = to_bits(number, jnp.int32)
    golden_bits = lax.bitcast_convert_type(golden_number, jnp.int32)
    differs = first_tick(now, (bits != golden_bits) & exists, history.differs)
    leaves = history.leaves
    if span is not None:
        golden_value = golden_number if is_float else golden_bits
        leaves_now = _outside(number, span) & ~_outside(golden_value, span)
        leaves = first_tick(now, leaves_now & exists, leaves)
    return NumberHistory(differs, leaves), bits


def series_length(setup: Setup) -> int:
    """Return how many numbers of a golden run are stored in each tick."""
    assert setup.explained is not None
    return inner_loop(setup).series_length(setup) + len(_compared(setup)) + setup.explained.checks


def outcomes(setup: Setup, params: Any, state: ExplainedState) -> dict[str, Scalar]:
    """Return the outcomes of the robot's loop and those of the observer."""
    loop = inner_loop(setup)
    columns = loop.outcomes(setup, params, state.tick)
    for compared, history in zip(_compared(setup), state.numbers, strict=True):
        columns[f"{DIFFERS}{compared.name}"] = history.differs
        if history.leaves is not None:
            columns[f"{LEAVES}{compared.name}"] = history.leaves
    for name, history in zip(loop.check_histories(setup, state.tick), state.margins, strict=True):
        columns[f"{NEAR}{name}"] = history.margin
        columns[f"{GOLDEN_NEAR}{name}"] = history.golden
        columns[f"{NEAR_MS}{name}"] = history.tick
    return columns | {HARM: state.harm}


def _compared(setup: Setup) -> tuple[Compared, ...]:
    assert setup.explained is not None
    return setup.explained.numbers


def _outside(number: Scalar, span: tuple[float, float]) -> Scalar:
    low, high = span
    value = lax.convert_element_type(number, jnp.float32)
    # In this form NaN is outside.
    return ~((value >= low) & (value <= high))
