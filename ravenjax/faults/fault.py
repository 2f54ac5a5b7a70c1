"""A fault as numbers, and what a fault remembers while it acts. Knows nothing of any robot."""

from __future__ import annotations

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import Setup
from ravenjax.numbers.vec import Scalar, record


@record
class FaultSlot:
    """One slot: what is done, where, and when. Codes are those of `vocabulary`; an empty slot
    has code 0.
    """

    # int32, 1-based place of the channel in the campaign's list of channels; 0: no fault
    code: Scalar
    effect: Scalar  # int32, EFFECT_CODES
    value: Scalar  # float, in the channel's unit
    trigger: Scalar  # int32, TRIGGER_CODES
    start: Scalar  # int32, ticks or packets on the trigger's clock
    duration: Scalar  # int32, ticks or packets that the window stays open
    every: Scalar  # int32, ticks or packets from one opening to the next; 0: opens once
    period: Scalar  # int32, ticks, of effect periodic
    key: Scalar  # uint32, of effect random


@record
class Faults:
    """The faults of one run."""

    slots: tuple[FaultSlot, ...]


@record
class SlotState:
    """What one slot remembers."""

    active: Scalar  # bool, the window is open in this tick
    age: Scalar  # int32, ticks since the window opened; 0 in its first tick
    latched: Scalar  # float, of effect latch_offset
    before: Scalar  # float, the channel in the last tick before the window; NaN: none was seen
    first_tick: Scalar  # int32, tick in which the fault first changed its channel; -1: never
    changed_ticks: Scalar  # int32, ticks in which it changed at least one bit
    last_tick: Scalar  # int32, tick in which it last changed its channel; -1: never


@record
class FaultState:
    """What the faults of one run remember."""

    slots: tuple[SlotState, ...]


def outcomes(state: FaultState) -> dict[str, Scalar]:
    """What the faults did so far; columns of the result table."""
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
    """State before the first tick."""
    zero = jnp.asarray(0.0, setup.precision.real)
    unseen = jnp.asarray(jnp.nan, setup.precision.real)
    slot = SlotState(
        jnp.bool_(False), jnp.int32(0), zero, unseen, jnp.int32(-1), jnp.int32(0), jnp.int32(-1)
    )
    return FaultState((slot,) * setup.injection.slots)
