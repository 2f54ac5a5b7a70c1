"""Stateless adapters between parts of the tick whose records differ."""

from __future__ import annotations

from typing import Any

from ravenjax.faults.injection import strikes
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import per_arm, real
from ravenjax.numbers.vec import Scalar, Vec, record, replace
from ravenjax.robots.raven2.console import operator
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.loop import control, user_files
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.robots.raven2.setup import RavenSetup


@record
class ConsoleSeam:
    """The console's numbers that a fault may change."""

    scale: Scalar


@record
class Network:
    """What a fault may do to the newest packet on its way to the robot."""

    # int32, packets; how much older the packet is that is sent instead
    lag: Scalar
    delay: Scalar  # int32, packets; delay of a channel that delivers in order
    lost: Scalar  # bool
    bursts: Scalar  # float, seed of the channel's losses; 0: none
    jitter: Scalar  # float, seed of the channel's delays; 0: none


@record
class PacketTiming:
    """A packet, and the rows of the motion from which it is made."""

    index: Scalar  # int32
    # int32, row of the motion with the state of the hands when it is made
    row: Scalar
    # int32, row of the packet before it, from which increments count
    before: Scalar


def row_by_row(index: Scalar) -> PacketTiming:
    """Return the timing of the packet with that index, if each is made from the motion's
    next row.
    """
    return PacketTiming(index, index, index - 1)


@record
class Buttons:
    """The buttons beside the robot; 1 is pressed."""

    estop: Scalar  # bool
    start: Scalar  # bool


@record
class UsbStatus:
    """Whether USB transfers succeed, one entry per arm."""

    read_ok: tuple[Scalar, ...]
    write_ok: tuple[Scalar, ...]


def boards_apart(setup: RavenSetup) -> int:
    """Return the number of USB boards whose output pins may differ.

    All boards are written alike, unless a write can fail or a board can refuse.
    """
    return len(setup.arms) if strikes(setup, "usb_status") or user_files.refuses(setup) else 1


def each(setup: RavenSetup, item: Any) -> tuple[Any, ...]:
    """Return a tuple with the same item for every arm."""
    return tuple(item for _ in setup.arms)


def packet(
    setup: RavenSetup,
    console: operator.OperatorParams,
    motion: tuple[Any, ...],
    timing: PacketTiming,
    hands: operator.HandOffsets = operator.ON_PLAN,
    deviation: operator.Deviation = operator.PLAN,
) -> Packet:
    """Return the packet of that timing, as `console` sends it: the operator's console, or a faulty
    one.
    """

    def row(index: Scalar, lag: Scalar | None, offset: tuple[Vec, ...]) -> operator.MotionRow:
        line = operator.lookup(motion, index if lag is None else index - lag)
        return operator.moved(line, offset) if offset else line

    new = row(timing.row, deviation.lag, hands.offset)
    old = row(timing.before, deviation.lag_before, hands.offset_before)
    if deviation.grasp is not None and deviation.grasp_before is not None:
        new = operator.closed(new, deviation.grasp)
        old = operator.closed(old, deviation.grasp_before)
    if deviation.lifted is not None:
        new = replace(new, surgeon_mode=jnp.where(deviation.lifted, 0, new.surgeon_mode))
    return operator.packet(setup, console, new, old, timing.index + 1)


def motors(setup: RavenSetup, robots: tuple[plant.PlantOutput, ...]) -> tuple[tuple[Vec, Vec], ...]:
    """Return what a dynamics-simulator build reads in place of encoders: motors 1-3 of each arm."""
    if setup.build == "robot":
        return ()
    return tuple((Vec(out.mpos[:3]), Vec(out.mvel[:3])) for out in robots)


def tips(
    setup: RavenSetup,
    params: tuple[plant.PlantParams, ...],
    states: tuple[plant.PlantState, ...],
    robots: tuple[plant.PlantOutput, ...],
) -> tuple[Vec, ...]:
    """Return the true tip of each arm, m in registered frame 0."""
    return per_arm(setup, lambda i, arm: plant.tip(arm, params[i], states[i], robots[i].jpos))


def plant_signal(
    current_cmd: Vec, brakes: Scalar, multipliers: dict[str, tuple[Vec, ...]], i: int
) -> plant.PlantSignal:
    """Return the input of the i-th arm of the virtual robot.

    multipliers: factors of the mechanics, by fault site.
    """
    return replace(
        plant.nominal_signal(current_cmd, brakes),
        **{site: arms[i] for site, arms in multipliers.items()},
    )


def measured(setup: RavenSetup, signals: control.ControlSignals) -> tuple[Vec, ...]:
    """Return the measured tip of each arm, whole um."""
    return tuple(real(setup, arm.pos.position_um) for arm in signals.arms)
