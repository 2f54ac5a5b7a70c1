"""Compares a run with its golden run, number by number, to find where and when a fault first shows.

This module is a `Loop` of `ravenjax.engines.interface`: the loop of `run` with an observer. In each
tick, the observer compares every number at a seam (`SEAMS`) with the golden run's number of the
same tick. Golden numbers are inputs of a lane, in a time series. In every campaign the golden run's
tips are such inputs too. Engines can therefore run many lanes at once and start them from snapshots
of golden runs. No trace is stored. The outcomes that `run` has too are equal to it bit by bit. With
both arms, 349 numbers are compared in each tick. The series of a golden run of 3 s has 4.5 MB.

`differs` is the first tick in which any bit of a number differs from the golden run's number.
`leaves` is the first tick in which a number is outside its normal range while the golden run's is
inside. Numbers of a packet are compared only in ticks in which a packet was received.
"""

from typing import Any

from ravenjax.faults import fault
from ravenjax.faults.injection import read_channel
from ravenjax.numbers import Scalar, cast_to_real, first_tick, jnp, lax, record, widen_numbers
from ravenjax.robots.raven2.declaration import CHECKS, SEAMS
from ravenjax.robots.raven2.geometry.mapping import quat_from_matrix
from ravenjax.robots.raven2.loop import run
from ravenjax.robots.raven2.loop.records import TickParams, TickSignals, TickState
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.vocabulary.seams import Crossing, list_crossings
from ravenjax.vocabulary.sites import ARM

DIFFERS, LEAVES = "differs:", "leaves:"
NEAR, GOLDEN_NEAR, NEAR_MS = "near:", "golden_near:", "near_ms:"
"""Prefixes of the names of outcomes: of a number's ticks, and of a check's margins until harm."""
HARM = "harm_ms"
"""Outcome: first tick in which any hazard of the motion was beyond its limit; -1: never."""


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

    tick: TickState
    numbers: tuple[NumberHistory, ...]  # in the order of `listing`
    margins: tuple[MarginHistory, ...]  # in the order of `run.check_histories`
    harm: Scalar  # int32, tick of the first harm; -1: none


def list_numbers(setup: RavenSetup) -> tuple[Crossing, ...]:
    """Return every number that is compared, in order."""
    return list_crossings(SEAMS, setup.arms)


def init(setup: RavenSetup, params: TickParams) -> ExplainedState:
    """Return the state of `run.init`, with no differences."""
    never, state = jnp.int32(-1), run.init(setup, params)
    infinite = cast_to_real(setup, jnp.inf)
    return ExplainedState(
        tick=state,
        numbers=tuple(
            NumberHistory(never, None if span is None else never) for span in _spans(setup)
        ),
        margins=tuple(
            MarginHistory(infinite, infinite, never) for _ in run.check_histories(setup, state)
        ),
        harm=never,
    )


def advance(
    setup: RavenSetup,
    params: TickParams,
    faults: fault.Faults,
    state: ExplainedState,
    now: Scalar,
    motion: tuple[Any, ...],
    golden: tuple[Scalar, ...],
) -> tuple[ExplainedState, tuple[Scalar, ...], TickSignals]:
    """Compute one tick as `run.advance`, then compare it with the golden run."""
    length = run.series_length(setup)
    checked = length + len(state.numbers)
    after, series, signals = run.advance(
        setup, params, faults, state.tick, now, motion, golden[:length]
    )
    numbers, carried = [], []
    for history, span, (number, present), other in zip(
        state.numbers,
        _spans(setup),
        crossing_numbers(setup, signals),
        golden[length:checked],
        strict=True,
    ):
        number = jnp.asarray(number)
        floats = number.dtype == jnp.float32
        to_bits = lax.bitcast_convert_type if floats else lax.convert_element_type
        bits = to_bits(number, jnp.int32)
        there = lax.bitcast_convert_type(other, jnp.int32)
        differs = first_tick(now, (bits != there) & present, history.differs)
        leaves = history.leaves
        if span is not None:
            outside = _outside(number, span) & ~_outside(other if floats else there, span)
            leaves = first_tick(now, outside & present, leaves)
        numbers.append(NumberHistory(differs, leaves))
        carried.append(lax.bitcast_convert_type(bits, jnp.float32))
    live, margins, nearest = state.harm < 0, [], []
    for before, check, other in zip(
        state.margins, run.check_histories(setup, after).values(), golden[checked:], strict=True
    ):
        # A check counts only before the first harm
        margin = cast_to_real(setup, check.margin)
        closer = live & (margin < before.margin)
        nearest.append(
            MarginHistory(
                margin=jnp.where(closer, margin, before.margin),
                golden=jnp.where(live, other, before.golden),
                tick=jnp.where(closer, now, before.tick),
            )
        )
        margins.append(margin)
    monitor = after.monitor
    harmful = (monitor.unintended >= 0) | (monitor.loss >= 0) | (monitor.false_report >= 0)
    harm = jnp.where(harmful & live, now, state.harm)
    explained = ExplainedState(after, tuple(numbers), tuple(nearest), harm)
    return explained, (*series, *carried, *margins), signals


def series_length(setup: RavenSetup) -> int:
    """Return the length of the series."""
    return run.series_length(setup) + len(_spans(setup)) + len(CHECKS) + len(setup.checks)


def outcomes(setup: RavenSetup, params: TickParams, state: ExplainedState) -> dict[str, Scalar]:
    """Return the outcomes of `run.outcomes` and those of the observer."""
    out = run.outcomes(setup, params, state.tick)
    for place, history in zip(list_numbers(setup), state.numbers, strict=True):
        out[f"{DIFFERS}{place.name}"] = history.differs
        if history.leaves is not None:
            out[f"{LEAVES}{place.name}"] = history.leaves
    for name, history in zip(run.check_histories(setup, state.tick), state.margins, strict=True):
        out |= {f"{NEAR}{name}": history.margin, f"{GOLDEN_NEAR}{name}": history.golden}
        out[f"{NEAR_MS}{name}"] = history.tick
    return out | {HARM: state.harm}


def crossing_numbers(setup: RavenSetup, signals: TickSignals) -> list[tuple[Scalar, Scalar]]:
    """Return (number, whether it exists in this tick) in the order of `list_numbers`."""
    arms, packet = signals.control.arms, signals.control.packet
    assert packet is not None
    rotations: dict[str, Any] = {}
    for name in ("pos", "pos_d"):
        poses = [getattr(arm, name).rotation for arm in arms]
        rotations[f"{name}_quaternion"] = [
            quat_from_matrix(widen_numbers(setup, pose)) for pose in poses
        ]
        rotations[f"{name}_matrix"] = [[x for row in pose for x in row] for pose in poses]
    numbers = []
    for place in list_numbers(setup):
        first, *path = (
            setup.arms.index(place.arm) if step == ARM else step  # type: ignore[arg-type]
            for step in place.channel.path
        )
        number = read_channel((rotations | vars(signals))[str(first)], tuple(path))
        of_packet = place.seam.name in ("packet_header", "packet")
        numbers.append((number, packet.received != 0 if of_packet else True))
    return numbers


def _spans(setup: RavenSetup) -> tuple[tuple[float, float] | None, ...]:
    return setup.explained or (None,) * len(list_numbers(setup))


def _outside(number: Scalar, span: tuple[float, float]) -> Scalar:
    low, high = span
    value = lax.convert_element_type(number, jnp.float32)
    return ~((value >= low) & (value <= high))
