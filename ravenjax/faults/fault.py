"""Defines a fault as numbers, the state of a fault, and the rule by which a fault is active."""

from ravenjax.numbers import Scalar, Setup, jnp, lax, record, replace
from ravenjax.vocabulary.effects import TRIGGER_CODES


@record
class FaultSlot:
    """One fault slot of a run: effect, channel and window. An empty slot has channel code 0.

    Codes are those of `ravenjax.vocabulary`.
    """

    code: Scalar  # int32, index from 1 in the campaign's list of channels; 0: no fault
    effect: Scalar  # int32, EFFECT_CODES
    value: Scalar  # float, in the channel's unit
    trigger: Scalar  # int32, TRIGGER_CODES
    start: Scalar  # int32, ticks or packets on the trigger's clock
    duration: Scalar  # int32, ticks or packets that the window stays open
    every: Scalar  # int32, ticks or packets from one opening to the next; 0: the window opens once
    period: Scalar  # int32, ticks, period of effect periodic
    key: Scalar  # uint32, random key of effect random


@record
class Faults:
    """All fault slots of one run."""

    slots: tuple[FaultSlot, ...]


@record
class SlotState:
    """The state of one fault slot."""

    active: Scalar  # bool, the window is open in this tick
    age: Scalar  # int32, ticks since the window opened; 0 in its first tick
    latched: Scalar  # float, the value that effect latch_offset latched
    before: Scalar  # float, the channel's value in the last tick before the window; NaN: never seen
    first_tick: Scalar  # int32, tick in which the fault first changed its channel; -1: never
    changed_ticks: Scalar  # int32, ticks in which the fault changed at least one bit of its channel
    last_tick: Scalar  # int32, tick in which it last changed its channel; -1: never


@record
class FaultState:
    """The state of all fault slots of one run."""

    slots: tuple[SlotState, ...]


def outcomes(state: FaultState) -> dict[str, Scalar]:
    """Return the outcome columns of faults: the first and the last tick in which each changed its
    channel (-1: never), the number of such ticks, and the first tick and the sum of all faults. An
    engine converts columns that end in `_ms` from ticks to ms.
    """
    columns = {}
    first, total = jnp.int32(-1), jnp.int32(0)
    for k, slot in enumerate(state.slots):
        columns[f"applied{k}_first_ms"] = slot.first_tick
        columns[f"applied{k}_last_ms"] = slot.last_tick
        columns[f"applied{k}_ticks"] = slot.changed_ticks
        is_earlier = (slot.first_tick >= 0) & ((first < 0) | (slot.first_tick < first))
        first = jnp.where(is_earlier, slot.first_tick, first)
        total = total + slot.changed_ticks
    return columns | {"first_active_ms": first, "active_ticks": total}


def init(setup: Setup) -> FaultState:
    """Return the state before the first tick."""
    zero = jnp.asarray(0.0, setup.precision.real)
    unseen = jnp.asarray(jnp.nan, setup.precision.real)
    never = jnp.int32(-1)
    active, age, ticks = jnp.bool_(False), jnp.int32(0), jnp.int32(0)
    slot = SlotState(active, age, zero, unseen, never, changed_ticks=ticks, last_tick=never)
    return FaultState((slot,) * setup.injection.slots)


@record
class TriggerClocks:
    """The clocks that determine when faults act, all int32."""

    tick: Scalar  # ticks since the run began
    packet: Scalar  # sequence number of the console's newest packet
    pedal: Scalar  # ticks since pedal-down was entered; negative: not in pedal-down


def _open_slot(setup: Setup, fault: FaultSlot, state: SlotState, clock: TriggerClocks) -> SlotState:
    # Returns the slot's state: the clock of the fault's trigger opens or shuts its window.
    triggers = setup.injection.triggers
    readings = {"time": clock.tick, "packet": clock.packet, "pedal": clock.pedal}
    reading = readings[triggers[0]]
    for name in triggers[1:]:
        reading = jnp.where(fault.trigger == TRIGGER_CODES[name], readings[name], reading)
    since_start = reading - fault.start
    if "pedal" in triggers:
        # While the pedal is up, -1 keeps the window shut.
        pedal_is_up = (fault.trigger == TRIGGER_CODES["pedal"]) & (clock.pedal < 0)
        since_start = jnp.where(pedal_is_up, -1, since_start)
    return open_window(fault, state, since_start)


def open_window(fault: FaultSlot, state: SlotState, since_start: Scalar) -> SlotState:
    """Return the slot's state: whether its window is open in this tick, and for how many ticks.
    since_start: int32, the clock's reading minus the start of the fault; negative: before it.
    """
    repeats = fault.every > 0
    # The divisor 1 avoids a division by 0.
    since_opening = jnp.where(
        repeats, lax.rem(since_start, jnp.where(repeats, fault.every, 1)), since_start
    )
    active = (fault.code > 0) & (since_start >= 0) & (since_opening < fault.duration)
    # A window that opens again begins with age 0.
    age = jnp.where(active & state.active & (since_opening > 0), state.age + 1, 0)
    return replace(state, active=active, age=age)


def open_windows(
    setup: Setup, faults: Faults, state: FaultState, clock: TriggerClocks
) -> FaultState:
    """Return the state with the windows of all faults as in this tick. Call this once per tick,
    before any fault site. Start and duration are on the trigger's clock. A window that is counted
    in packets is open in every tick of these packets.
    """
    # The campaign may have slots although no run has a fault.
    if not setup.injection.triggers:
        return state
    return FaultState(
        tuple(
            _open_slot(setup, fault, slot, clock)
            for fault, slot in zip(faults.slots, state.slots, strict=True)
        )
    )
