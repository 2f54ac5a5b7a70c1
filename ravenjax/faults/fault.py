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
    """Return when and how often each fault changed its channel, as columns of the result table."""
    out: dict[str, Scalar] = {}
    first, ticks = jnp.int32(-1), jnp.int32(0)
    for k, slot in enumerate(state.slots):
        out[f"applied{k}_first_ms"] = slot.first_tick
        out[f"applied{k}_last_ms"] = slot.last_tick
        out[f"applied{k}_ticks"] = slot.changed_ticks
        earlier = (slot.first_tick >= 0) & ((first < 0) | (slot.first_tick < first))
        first = jnp.where(earlier, slot.first_tick, first)
        ticks = ticks + slot.changed_ticks
    return out | {"first_active_ms": first, "active_ticks": ticks}


def init(setup: Setup) -> FaultState:
    """Return the state before the first tick."""
    zero = jnp.asarray(0.0, setup.precision.real)
    unseen = jnp.asarray(jnp.nan, setup.precision.real)
    slot = SlotState(
        jnp.bool_(False), jnp.int32(0), zero, unseen, jnp.int32(-1), jnp.int32(0), jnp.int32(-1)
    )
    return FaultState((slot,) * setup.injection.slots)


# --- windows ---


@record
class TriggerClocks:
    """The clocks that determine when faults act, all int32."""

    tick: Scalar  # ticks since the run began
    packet: Scalar  # sequence number of the console's newest packet
    pedal: Scalar  # ticks since pedal-down was entered; negative: not in pedal-down


def _slot(setup: Setup, fault: FaultSlot, state: SlotState, clock: TriggerClocks) -> SlotState:
    # Updates whether the slot's fault acts, from the clock of its trigger: time, packets or pedal.
    used = setup.injection.triggers
    readings = {"time": clock.tick, "packet": clock.packet, "pedal": clock.pedal}
    reading = readings[used[0]]
    for name in used[1:]:
        reading = jnp.where(fault.trigger == TRIGGER_CODES[name], readings[name], reading)
    since = reading - fault.start
    if "pedal" in used:
        shut = (fault.trigger == TRIGGER_CODES["pedal"]) & (clock.pedal < 0)
        since = jnp.where(shut, -1, since)
    return open_window(fault, state, since)


def open_window(fault: FaultSlot, state: SlotState, since: Scalar) -> SlotState:
    """Update whether the fault of a slot acts in this tick, and for how many ticks it has acted.

    since: int32, the clock's reading minus the start of the fault; negative: before the start.
    """
    repeats = fault.every > 0
    cycle = jnp.where(repeats, lax.rem(since, jnp.where(repeats, fault.every, 1)), since)
    active = (fault.code > 0) & (since >= 0) & (cycle < fault.duration)
    age = jnp.where(active & state.active & (cycle > 0), state.age + 1, 0)
    return replace(state, active=active, age=age)


def open_windows(
    setup: Setup, faults: Faults, state: FaultState, clock: TriggerClocks
) -> FaultState:
    """Update which faults act in this tick. Call this once per tick, before any fault site.

    Start and duration are on the trigger's clock. A fault that counts packets acts in all ticks of
    a packet.
    """
    # The campaign may have slots although no run has a fault.
    if not setup.injection.triggers:
        return state
    return FaultState(
        tuple(_slot(setup, f, s, clock) for f, s in zip(faults.slots, state.slots, strict=True))
    )
