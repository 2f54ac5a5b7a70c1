"""When a fault acts: its window on the clock of its trigger. Knows nothing of any robot."""

from __future__ import annotations

from ravenjax.faults.fault import Faults, FaultSlot, FaultState, SlotState
from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.setup import Setup
from ravenjax.numbers.vec import Scalar, record, replace
from ravenjax.vocabulary.effects import TRIGGER_CODES


@record
class TriggerClocks:
    """The clocks that triggers read, all int32."""

    tick: Scalar  # ticks since the run began
    packet: Scalar  # sequence number of the console's newest packet
    pedal: Scalar  # ticks since pedal-down was entered; negative: not in pedal-down


def _elapsed(setup: Setup, fault: FaultSlot, clock: TriggerClocks) -> Scalar:
    """Trigger's clock reading minus the fault's start."""
    used = setup.injection.triggers
    readings = {"time": clock.tick, "packet": clock.packet, "pedal": clock.pedal}
    reading = readings[used[0]]
    for name in used[1:]:
        reading = jnp.where(fault.trigger == TRIGGER_CODES[name], readings[name], reading)
    since = reading - fault.start
    if "pedal" in used:
        shut = (fault.trigger == TRIGGER_CODES["pedal"]) & (clock.pedal < 0)
        since = jnp.where(shut, -1, since)
    return since


def _slot(setup: Setup, fault: FaultSlot, state: SlotState, clock: TriggerClocks) -> SlotState:
    since = _elapsed(setup, fault, clock)
    repeats = fault.every > 0
    cycle = jnp.where(repeats, lax.rem(since, jnp.where(repeats, fault.every, 1)), since)
    active = (fault.code > 0) & (since >= 0) & (cycle < fault.duration)
    age = jnp.where(active & state.active & (cycle > 0), state.age + 1, 0)
    return replace(state, active=active, age=age)


def open_windows(
    setup: Setup, faults: Faults, state: FaultState, clock: TriggerClocks
) -> FaultState:
    """Once a tick, before any site: which slots act in this tick, and for how long they have.

    A window counts on its trigger's clock, so one that counts packets stays open while its packet
    lasts.
    """
    if not setup.injection.triggers:  # slots, but no fault in any run
        return state
    return FaultState(
        tuple(_slot(setup, f, s, clock) for f, s in zip(faults.slots, state.slots, strict=True))
    )
