"""Injects faults into the signals of a simulated robot, between two parts of its tick.

Fault sites and channels are declared in `ravenjax.vocabulary.sites`. The setting `Setup.injection`
of a campaign names the sites with faults, and only these sites add code to the tick. At a site,
each fault slot selects its channel, applies its effect once, and writes the result back. Every
other channel keeps its bits.
"""

import dataclasses
import functools
import math
from collections.abc import Mapping
from typing import Any

from ravenjax.faults.fault import Faults, FaultSlot, FaultState, SlotState, TriggerClocks
from ravenjax.numbers import Scalar, Vec, as_int, first_tick, jnp, lax, paths
from ravenjax.numbers.counter_random import random_uniform
from ravenjax.numbers.setup import Setup, SiteUse
from ravenjax.numbers.vec import replace, to_int32, wrap16
from ravenjax.vocabulary.effects import EFFECT_CODES
from ravenjax.vocabulary.robot import Robot
from ravenjax.vocabulary.sites import ARM, PARAMETER


def flip_bit(x: Scalar, fault: FaultSlot) -> Scalar:
    """Return an int32 with the fault's bit inverted."""
    return x ^ (1 << (to_int32(fault.value) & 31))


def _apply_effect(
    effect: str, x: Scalar, fault: FaultSlot, slot: SlotState, tick: Scalar
) -> Scalar:
    """Return the float that replaces the float `x` under an effect. For effect bit_flip on whole
    numbers, the result is not used (see `FaultAction.replacement`).
    """
    match effect:
        case "overwrite":
            return fault.value
        case "offset":
            return x + fault.value
        case "latch_offset":
            return jnp.where(slot.age == 0, x + fault.value, slot.latched)
        case "scale":
            return x * fault.value
        case "drift":
            return x + fault.value * lax.convert_element_type(slot.age + 1, x.dtype)
        case "stuck":
            # `before` is NaN, which is not equal to itself, if the fault acts from the first tick.
            # It then keeps the x of this tick, which `FaultAction.slot_after` stores.
            return jnp.where(slot.before == slot.before, slot.before, x)
        case "bit_flip":
            pattern = lax.bitcast_convert_type(lax.convert_element_type(x, jnp.float32), jnp.int32)
            return lax.bitcast_convert_type(flip_bit(pattern, fault), jnp.float32)
        case "periodic":
            period = jnp.maximum(fault.period, 1)
            phase = lax.convert_element_type(lax.rem(slot.age, period), x.dtype)
            turn = phase / lax.convert_element_type(period, x.dtype)
            return x + fault.value * jnp.sin(2.0 * math.pi * turn)
        case "random":
            uniform = lax.convert_element_type(random_uniform(fault.key, tick, channel=0), x.dtype)
            return fault.value * (2.0 * uniform - 1.0)
        case "lose":
            # Remaining ticks of the current loss, stored in `latched`; 0: no loss.
            remaining = jnp.where(slot.age == 0, 0.0, jnp.maximum(slot.latched - 1.0, 0.0))
            length = lax.convert_element_type(fault.period, x.dtype)
            is_lost = random_uniform(fault.key, tick, channel=0) < fault.value
            return jnp.where(is_lost, length, remaining)
    assert effect == "toggle"
    return jnp.where((slot.age & 1) == 0, fault.value, 0.0)


class FaultAction:
    """The action of one fault on one number in one tick.

    acts: bool, True if the fault acts in this tick, on a channel of this site, which is present.
    """

    def __init__(
        self,
        effects: tuple[str, ...],
        fault: FaultSlot,
        slot: SlotState,
        x: Scalar,
        tick: Scalar,
        on_channel: Scalar,
        present: Scalar,
    ):
        """Compute the float that replaces `x`. effects: all effects that occur at the site.
        on_channel: bool, the fault's channel belongs to the site. present: bool, the signal exists.
        """
        first, *others = effects
        y = _apply_effect(first, x, fault, slot, tick)
        for name in others:
            is_effect = fault.effect == EFFECT_CODES[name]
            y = jnp.where(is_effect, _apply_effect(name, x, fault, slot, tick), y)
        self._faulty_float = lax.convert_element_type(y, x.dtype)
        self.acts = slot.active & on_channel & present
        self._flips = fault.effect == EFFECT_CODES["bit_flip"]
        # Whether the slot stores the faulty number: when its window opens; for "lose" in each tick.
        self._latches = slot.age == 0
        if "lose" in effects:
            self._latches = self._latches | (fault.effect == EFFECT_CODES["lose"])
        self._may_flip = "bit_flip" in effects
        self._fault, self._slot, self._x, self._tick = fault, slot, x, tick
        self._on_channel = on_channel

    def replacement(self, kind: str, number: Scalar) -> tuple[Scalar, Scalar]:
        """Return the number that replaces `number`, and whether the two differ in a bit."""
        value = _store(kind, self._faulty_float, number)
        differs = value != number
        if self._may_flip and kind == "float":
            # A flipped bit always differs. The comparison may miss this difference if both floats
            # are denormals or 0, because some engines compare denormals as 0.
            differs = differs | self._flips
        elif self._may_flip:
            # Whole numbers and truth values are flipped in their own bits.
            bits = flip_bit(lax.convert_element_type(number, jnp.int32), self._fault)
            bits = _fit_width(kind, bits)
            value = jnp.where(self._flips, lax.convert_element_type(bits, number.dtype), value)
            differs = value != number
        return value, differs

    def slot_after(self, changed: Scalar) -> SlotState:
        """Return the slot's state after this tick. changed: bool, the fault changed a bit."""
        slot, tick = self._slot, self._tick
        latched = jnp.where(self.acts & self._latches, self._faulty_float, slot.latched)
        # `before` is the last value before the window. A fault that is active from the first tick
        # has none: `before` is still NaN, which differs from itself, and the present value is kept.
        stores_value = self._on_channel & (~slot.active | (slot.before != slot.before))
        return replace(
            slot,
            latched=latched,
            before=jnp.where(stores_value, self._x, slot.before),
            first_tick=first_tick(tick, changed, slot.first_tick),
            last_tick=jnp.where(changed, tick, slot.last_tick),
            changed_ticks=slot.changed_ticks + as_int(changed),
        )


Path = tuple[str | int, ...]
ChannelKey = tuple[str, str, str]
"""(site, arm or "", channel)."""
Target = tuple[Path, str]
"""Path of a channel in the signal of its site, and the channel's number type."""


def read_channel(signal: Any, path: Path) -> Scalar:
    """Return the number at `path` of a site's signal."""
    for step in path:
        signal = getattr(signal, step) if isinstance(step, str) else signal[step]
    return signal


def write_channel(signal: Any, path: Path, value: Scalar) -> Any:
    """Return a copy of a site's signal with `value` at `path`, names of fields and indices."""
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(step, str):
        return replace(signal, **{step: write_channel(getattr(signal, step), rest, value)})
    items = list(signal)
    items[step] = write_channel(items[step], rest, value)
    return Vec(items) if isinstance(signal, Vec) else tuple(items)


def _store(kind: str, y: Scalar, old: Scalar) -> Scalar:
    """Return `y` (float) in the type of the number `old`. Beyond int32 it becomes -2147483648."""
    if kind == "float":
        return lax.convert_element_type(y, old.dtype)
    if kind == "bool":
        return lax.convert_element_type(y != 0.0, old.dtype)
    return lax.convert_element_type(_fit_width(kind, to_int32(y)), old.dtype)


def _fit_width(kind: str, whole: Scalar) -> Scalar:
    # Returns an int32 as the number that a channel of this type can store.
    if kind == "int16":
        return wrap16(whole)
    if kind == "int16 saturated":
        return jnp.minimum(jnp.maximum(whole, -32768), 32767)
    return whole


@dataclasses.dataclass(eq=False)
class Injector:
    """Injects faults in one tick: call it with each site and its signal, in order."""

    setup: Any  # a setup of the robot's class
    # For each channel of `Injection.channels`: its path in the signal of its site, and its number
    # type, which is "int16", "int16 saturated", "int32", "float" or "bool".
    paths: Mapping[ChannelKey, Target]
    faults: Faults
    state: FaultState
    clock: TriggerClocks

    def injects_at(self, *sites: str) -> bool:
        """Return whether the campaign injects faults at any of these sites."""
        return injects_faults(self.setup, *sites)

    def inject_parameters(self, params: Any) -> Any:
        """Return `params` with faults. Channels of site PARAMETER are full paths of parameters."""
        keys = [key for key in self.setup.injection.channels if key[0] == PARAMETER]
        numbers = Vec(
            jnp.asarray(paths.named_numbers(params, self.setup, path)[path]) for _, _, path in keys
        )
        # The vector of these parameters is the signal of this site, so a channel's position in the
        # signal is an index. `self.paths` needs it, and the number's type, which is known only now.
        for i, (key, number) in enumerate(zip(keys, numbers, strict=True)):
            kind = "float" if jnp.issubdtype(number.dtype, jnp.floating) else "int32"
            self.paths = {**self.paths, key: ((i,), kind)}
        # Applies the faults of this site to its signal.
        faulty_numbers = self(site=PARAMETER, signal=numbers)
        for (_, _, path), number in zip(keys, faulty_numbers, strict=True):
            params = paths.assign_numbers(params, self.setup, path, number)
        return params

    def __call__(self, site: str, signal: Any, present: Scalar = True) -> Any:
        """Return a site's signal with its faults. present: bool, the signal exists in this tick."""
        keys = self.setup.injection.channels
        for use in self.setup.injection.sites:
            if use.site != site:
                continue
            # (code, path, number type) of each channel of this site.
            targets = [(i + 1, *self.paths[key]) for i, key in enumerate(keys) if key[0] == site]
            slots = list(self.state.slots)
            for i, fault in enumerate(self.faults.slots):
                slots[i], signal = self._inject_slot(use, targets, fault, slots[i], signal, present)
            self.state = FaultState(tuple(slots))
        return signal

    def _inject_slot(
        self,
        use: SiteUse,
        targets: list[tuple[int, Path, str]],
        fault: FaultSlot,
        slot: SlotState,
        signal,
        present: Scalar,
    ) -> tuple[SlotState, Any]:
        """Apply the fault of one slot at one site. Return the slot's state and the signal. targets:
        (code, path, number type) of each channel. present: bool, the signal exists now.
        """
        real = self.setup.precision.real
        numbers = [jnp.asarray(read_channel(signal, path)) for _, path, _ in targets]
        is_target = [fault.code == code for code, _, _ in targets]
        # x: the number of the fault's channel; without meaning if no channel of the site has the
        # fault. on_channel: the fault's channel belongs to the site.
        x = lax.convert_element_type(numbers[0], real)
        on_channel = is_target[0]
        for selected, number in zip(is_target[1:], numbers[1:], strict=True):
            x = jnp.where(selected, lax.convert_element_type(number, real), x)
            on_channel = on_channel | selected
        action = FaultAction(use.effects, fault, slot, x, self.clock.tick, on_channel, present)
        changed = jnp.bool_(False)
        for selected, number, (_, path, kind) in zip(is_target, numbers, targets, strict=True):
            value, differs = action.replacement(kind, number)
            changed = changed | (action.acts & selected & differs)
            signal = write_channel(signal, path, jnp.where(action.acts & selected, value, number))
        return action.slot_after(changed), signal


def injects_faults(setup: Setup, *sites: str) -> bool:
    """Return whether the campaign injects faults at any of these sites."""
    return any(use.site in sites for use in setup.injection.sites)


@functools.cache
def channel_paths(robot: Robot, setup: Setup) -> dict[ChannelKey, Target]:
    """Return path and number type of each channel with faults, except of parameters."""
    targets = {}
    for site, arm, name in setup.injection.channels:
        if site == PARAMETER:
            continue
        channel = robot.sites[site].channel(name)
        path = tuple(setup.arms.index(arm) if step == ARM else step for step in channel.path)
        targets[site, arm, name] = (path, channel.kind)
    return targets
