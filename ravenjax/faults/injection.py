"""Injection: one pure function, called at each named site of the tick. Knows nothing of any robot.

Sites and channels are declared in `ravenjax.vocabulary.sites`; a campaign's `Setup.injection` names
those it uses, and only they cost anything. At a site, each slot gathers the channel it hits by
selects, applies its effect once and scatters the result back by selects. A channel that is not hit
keeps every bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ravenjax.faults import effects
from ravenjax.faults.fault import Faults, FaultSlot, FaultState, SlotState
from ravenjax.faults.window import TriggerClocks
from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.setup import Setup, SiteUse
from ravenjax.numbers.vec import Scalar, Vec, replace, to_int32, wrap16
from ravenjax.vocabulary.effects import EFFECT_CODES

Path = tuple[str | int, ...]
ChannelKey = tuple[str, str, str]
"""(site, arm or "", channel)."""
Target = tuple[Path, str]
"""Where a channel stands in its site's signal, and its kind."""


def channel_keys(setup: Setup) -> tuple[ChannelKey, ...]:
    """Every channel that the campaign hits; a fault's code is its place here plus one."""
    return tuple(
        (use.site, arm, channel) for use in setup.injection.sites for arm, channel in use.channels
    )


def read(signal: Any, path: Path) -> Scalar:
    """The number at `path` of a site's signal."""
    for step in path:
        signal = getattr(signal, step) if isinstance(step, str) else signal[step]
    return signal


def write(signal: Any, path: Path, value: Scalar) -> Any:
    """A copy of a site's signal with `value` at `path`."""
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(step, str):
        return replace(signal, **{step: write(getattr(signal, step), rest, value)})
    items = list(signal)
    items[step] = write(items[step], rest, value)
    return Vec(items) if isinstance(signal, Vec) else tuple(items)


def _store(kind: str, y: Scalar, old: Scalar) -> Scalar:
    """`y` (float) as the channel holds it: integers truncate, 16-bit ones wrap or saturate, what no
    int32 holds is -2147483648."""
    if kind == "float":
        return lax.convert_element_type(y, old.dtype)
    if kind == "bool":
        return lax.convert_element_type(y != 0.0, old.dtype)
    return lax.convert_element_type(_fitted(kind, to_int32(y)), old.dtype)


def _fitted(kind: str, whole: Scalar) -> Scalar:
    """An int32 as a channel of this kind holds it."""
    if kind == "int16":
        return wrap16(whole)
    return jnp.minimum(jnp.maximum(whole, -32768), 32767) if kind == "int16 saturated" else whole


def _strike(
    setup: Setup,
    use: SiteUse,
    targets: list[tuple[int, Path, str]],
    fault: FaultSlot,
    slot: SlotState,
    clock: TriggerClocks,
    signal: Any,
    present: Scalar,
) -> tuple[SlotState, Any]:
    """One slot at one site; `targets` are (code, path, kind) of the site's channels."""
    numbers = [jnp.asarray(read(signal, path)) for _, path, _ in targets]
    aims = [fault.code == code for code, _, _ in targets]
    x = lax.convert_element_type(numbers[0], setup.precision.real)
    here = aims[0]
    for aim, number in zip(aims[1:], numbers[1:], strict=True):
        x = jnp.where(aim, lax.convert_element_type(number, setup.precision.real), x)
        here = here | aim
    y = effects.apply(use.effects, x, fault, slot, clock.tick)

    hit = slot.active & here & present
    changed = jnp.bool_(False)
    flips = fault.effect == EFFECT_CODES["bit_flip"]
    for aim, number, (_, path, kind) in zip(aims, numbers, targets, strict=True):
        value = _store(kind, y, number)
        differs = value != number
        if "bit_flip" in use.effects and kind == "float":
            differs = (
                differs | flips
            )  # of a 0 the lowest bit makes a number that an engine may take for 0
        elif "bit_flip" in use.effects:
            bits = effects.flipped(lax.convert_element_type(number, jnp.int32), fault)
            bits = _fitted(kind, bits)
            value = jnp.where(flips, lax.convert_element_type(bits, number.dtype), value)
            differs = value != number
        changed = changed | (hit & aim & differs)
        signal = write(signal, path, jnp.where(hit & aim, value, number))
    return (
        replace(
            slot,
            latched=jnp.where(hit & (slot.age == 0), y, slot.latched),
            before=jnp.where(here & (~slot.active | (slot.before != slot.before)), x, slot.before),
            first_tick=jnp.where(changed & (slot.first_tick < 0), clock.tick, slot.first_tick),
            last_tick=jnp.where(changed, clock.tick, slot.last_tick),
            changed_ticks=slot.changed_ticks + lax.convert_element_type(changed, jnp.int32),
        ),
        signal,
    )


def inject(
    setup: Setup,
    paths: Mapping[ChannelKey, Target],
    faults: Faults,
    state: FaultState,
    clock: TriggerClocks,
    site: str,
    signal: Any,
    present: Scalar = True,
) -> tuple[FaultState, Any]:
    """The signal of `site` as the faults leave it.

    paths: where each channel of `channel_keys` stands in its site's signal, and its kind ("int16",
    "int16 saturated", "int32", "float", "bool"). present: bool, whether there is anything to strike
    in this tick. A site that the campaign does not use costs nothing.
    """
    keys = channel_keys(setup)
    for use in setup.injection.sites:
        if use.site != site:
            continue
        targets = [(i + 1, *paths[key]) for i, key in enumerate(keys) if key[0] == site]
        slots = list(state.slots)
        for i, fault in enumerate(faults.slots):
            slots[i], signal = _strike(setup, use, targets, fault, slots[i], clock, signal, present)
        state = FaultState(tuple(slots))
    return state, signal
