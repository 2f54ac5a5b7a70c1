"""A run of ticks that is compared with its golden run number by number: where a fault's effect
appears first, and when.

This module is a `Loop` of `ravenjax.engines.interface`: that of `run`, beside which an observer
compares each number that crosses a seam (`SEAMS`) with the golden run's of
the same tick. The golden run's numbers come the way that its tips come in any campaign, as a
series. So engines run it in bulk, from branches of golden runs and with what a group shares
computed once, and no trace is ever stored. What a run does is untouched: the tick is the same
function, and a lane's outcomes have the bits of `run`.

The price, both arms: 349 numbers a tick are compared, of which 234 have a range, some 5 000 further
operations beside the tick's own; and a golden run's series is 3 s x 376 numbers x 4 bytes = 4.5 MB
long. Where runs share golden runs that is nothing: their lanes go on from branches of it and read
it once for a whole vector. The other way, two traces of each run in blocks and NumPy afterwards,
would move 2 x 4.5 MB a run, 90 GB for ten thousand, through memory. Where each run has a golden run
of its own this way moves as much; two ticks side by side in each lane would spare that.

A number *differs* in the first tick in which any bit is another than the golden run's; it *leaves
its range* in the first in which it lies outside of its normal range while the golden run's lies
inside. Content of a packet counts where a packet was received.
"""

from __future__ import annotations

from typing import Any

from ravenjax.faults import fault
from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.setup import real, wide
from ravenjax.numbers.vec import Scalar, record
from ravenjax.robots.raven2.declaration import CHECKS, SEAMS
from ravenjax.robots.raven2.geometry.mapping import quat_from_matrix
from ravenjax.robots.raven2.loop import run
from ravenjax.robots.raven2.loop.records import TickParams, TickSignals, TickState
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.vocabulary.seams import Crossing, crossings

DIFFERS, LEAVES, NEAR, GOLDEN_NEAR, NEAR_MS = (
    "differs:",
    "leaves:",
    "near:",
    "golden_near:",
    "near_ms:",
)
"""Beginnings of the names of outcomes: of a number's ticks, and of a check's margins until harm."""
HARM = "harm_ms"
"""Outcome: the first tick in which any hazard of the motion was beyond its limit; -1: none."""


@record
class NumberHistory:
    """Of one number that crosses a seam."""

    differs: Scalar  # int32, first tick in which it is not the golden run's; -1: never
    leaves: (
        Scalar | None
    )  # int32, first tick out of its normal range, the golden run's inside; None: it has no range


@record
class MarginHistory:
    """Of one check, until harm."""

    margin: Scalar  # smallest distance to the limit, as in `stages.check`
    golden: Scalar  # the golden run's until the same tick
    tick: Scalar  # int32, when it was smallest; -1: nothing was measured


@record
class ExplainedState:
    """A run's state, and what the observer remembers."""

    tick: TickState
    numbers: tuple[NumberHistory, ...]  # in the order of `listing`
    margins: tuple[MarginHistory, ...]  # in the order of `run.checks`
    harm: Scalar  # int32


def listing(setup: RavenSetup) -> tuple[Crossing, ...]:
    """Every number that is compared, in order."""
    return crossings(SEAMS, setup.arms)


def init(setup: RavenSetup, params: TickParams) -> ExplainedState:
    """As `run.init`; nothing differs yet."""
    never, state = jnp.int32(-1), run.init(setup, params)
    infinite = real(setup, jnp.inf)
    return ExplainedState(
        tick=state,
        numbers=tuple(
            NumberHistory(never, None if span is None else never) for span in _spans(setup)
        ),
        margins=tuple(MarginHistory(infinite, infinite, never) for _ in run.checks(setup, state)),
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
    """As `run.advance`, then the comparison."""
    own = run.series_length(setup)
    after, series, signals = run.advance(
        setup, params, faults, state.tick, now, motion, golden[:own]
    )
    beside, margins_beside = golden[own : own + len(state.numbers)], golden[own:]
    numbers, carried = [], []
    for history, span, (number, present), other in zip(
        state.numbers, _spans(setup), crossing(setup, signals), beside, strict=True
    ):
        number = jnp.asarray(number)
        floats = number.dtype == jnp.float32
        bits = (
            lax.bitcast_convert_type(number, jnp.int32)
            if floats
            else lax.convert_element_type(number, jnp.int32)
        )
        there = lax.bitcast_convert_type(other, jnp.int32)
        differs, leaves = _first((bits != there) & present, history.differs, now), history.leaves
        if span is not None:
            outside = _outside(number, span) & ~_outside(other if floats else there, span)
            leaves = _first(outside & present, leaves, now)
        numbers.append(NumberHistory(differs, leaves))
        carried.append(lax.bitcast_convert_type(bits, jnp.float32))
    live, margins, nearest = state.harm < 0, [], []
    for before, check, other in zip(
        state.margins,
        run.checks(setup, after).values(),
        margins_beside[len(numbers) :],
        strict=True,
    ):
        # a check counts where no harm came before it
        margin = real(setup, check.margin)
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
    """How many numbers the series has."""
    return run.series_length(setup) + len(_spans(setup)) + len(CHECKS) + len(setup.checks)


def outcomes(setup: RavenSetup, params: TickParams, state: ExplainedState) -> dict[str, Scalar]:
    """As `run.outcomes`, then what the observer remembers."""
    out = run.outcomes(setup, params, state.tick)
    for place, history in zip(listing(setup), state.numbers, strict=True):
        out[f"{DIFFERS}{place.name}"] = history.differs
        if history.leaves is not None:
            out[f"{LEAVES}{place.name}"] = history.leaves
    for name, history in zip(run.checks(setup, state.tick), state.margins, strict=True):
        out |= {f"{NEAR}{name}": history.margin, f"{GOLDEN_NEAR}{name}": history.golden}
        out[f"{NEAR_MS}{name}"] = history.tick
    return out | {HARM: state.harm}


def crossing(setup: RavenSetup, signals: TickSignals) -> list[tuple[Scalar, Scalar]]:
    """(number, whether it is there in this tick) in the order of `listing`."""
    control = signals.control
    packet: Any = control.packet
    numbers_of: dict[str, Any] = {
        "network": (signals.packet.received, signals.packet.sequence),
        "packet_header": (packet.sequence, packet.surgeon_mode, packet.size),
        "packet": [
            (*delta, *quat, grasp)
            for delta, quat, grasp in zip(packet.delta, packet.quat, packet.grasp, strict=True)
        ],
        "runlevel": (control.runlevel, control.soft_estopped, control.surgeon_mode),
        "pins_out": (control.pins_out,),
        "plc": (signals.plc.runlevel,),
        "brake": (signals.plc.brakes,),
        "boards": signals.boards,
        "tip": signals.tip,
    }
    for seam, name in _OF_ARM.items():
        numbers_of[seam] = [getattr(arm, name) for arm in control.arms]
    for seam, name in _OF_PLANT.items():
        numbers_of[seam] = [getattr(out, name) for out in signals.plant]
    for position, rotation, name in (("pos", "ori", "pos"), ("pos_d", "ori_d", "pos_d")):
        poses = [getattr(arm, name) for arm in control.arms]
        numbers_of[position] = [pose.position_um for pose in poses]
        numbers_of[rotation] = [
            (
                *quat_from_matrix(wide(setup, pose.rotation)),
                *(entry for row in pose.rotation for entry in row),
            )
            for pose in poses
        ]
    received = packet.received != 0
    return [
        (number, received if name in _OF_PACKETS else True)
        for name, seam in SEAMS.items()
        for numbers in (numbers_of[name] if seam.per_arm else [numbers_of[name]])
        for number in numbers
    ]


_OF_PACKETS = ("packet_header", "packet")
_OF_ARM = {
    "usb_in": "enc_val",
    **{
        name: name
        for name in ("mpos", "mvel", "jpos", "jvel", "jpos_d", "mpos_d", "tau_d", "current_cmd")
    },
    "checked_cmd": "current_cmd_checked",
    "usb_out": "current_cmd_written",
}
_OF_PLANT = {
    "motor_mpos": "mpos",
    "motor_mvel": "mvel",
    "cable_tension": "tension",
    "link_jpos": "jpos",
    "link_jvel": "jvel",
    "encoder": "enc_val",
}
"""Seam -> field of `control.ArmSignals`, of `plant.robot.PlantOutput`."""


def _spans(setup: RavenSetup) -> tuple[tuple[float, float] | None, ...]:
    """Normal range of each number of `listing`."""
    return setup.explained or (None,) * len(listing(setup))


def _outside(number: Scalar, span: tuple[float, float]) -> Scalar:
    """Whether a number is out of a range; one that is not finite is."""
    low, high = span
    value = lax.convert_element_type(number, jnp.float32)
    return ~((value >= low) & (value <= high))


def _first(happens: Scalar, before: Scalar, now: Scalar) -> Scalar:
    return jnp.where(happens & (before < 0), now, before)
