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


def _affected(effect: str, x: Scalar, fault: FaultSlot, slot: SlotState, tick: Scalar) -> Scalar:
    """Return the float that replaces `x` under an effect.

    For whole numbers under effect bit_flip, `flip_bit` is used instead.
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
            # A fault that acts from the first tick has no earlier value, so it keeps the number of
            # the first tick.
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
            uniform = lax.convert_element_type(random_uniform(fault.key, tick, 0), x.dtype)
            return fault.value * (2.0 * uniform - 1.0)
        case "lose":
            # Remaining ticks of the current loss, stored in `latched`; 0: no loss.
            before = jnp.where(slot.age == 0, 0.0, jnp.maximum(slot.latched - 1.0, 0.0))
            length = lax.convert_element_type(fault.period, x.dtype)
            return jnp.where(random_uniform(fault.key, tick, 0) < fault.value, length, before)
    assert effect == "toggle"
    return jnp.where((slot.age & 1) == 0, fault.value, 0.0)


class Strike:
    """The action of one fault on one number in one tick.

    hit: bool, True if the fault acts in this tick, on a channel of this site, which is present.
    """

    def __init__(
        self,
        effects: tuple[str, ...],
        fault: FaultSlot,
        slot: SlotState,
        x: Scalar,
        tick: Scalar,
        here: Scalar,
        present: Scalar,
    ) -> None:
        """Compute the float that replaces `x`. effects: all effects that occur at the site.

        here: bool, the fault's channel is one of the site. present: bool, the signal exists.
        """
        first, *others = effects
        y = _affected(first, x, fault, slot, tick)
        for name in others:
            y = jnp.where(
                fault.effect == EFFECT_CODES[name], _affected(name, x, fault, slot, tick), y
            )
        self._y = lax.convert_element_type(y, x.dtype)
        self.hit = slot.active & here & present
        self._flips = fault.effect == EFFECT_CODES["bit_flip"]
        self._latches = slot.age == 0
        if "lose" in effects:
            self._latches = self._latches | (fault.effect == EFFECT_CODES["lose"])
        self._may_flip = "bit_flip" in effects
        self._fault, self._slot, self._x, self._tick, self._here = fault, slot, x, tick, here

    def replacement(self, kind: str, number: Scalar) -> tuple[Scalar, Scalar]:
        """Return the number that replaces `number` in a channel of this type, and whether they
        differ in a bit.
        """
        value = _store(kind, self._y, number)
        differs = value != number
        if self._may_flip and kind == "float":
            # Flipping the lowest bit of 0 gives a denormal, which compares equal to 0 on engines
            # that flush denormals.
            differs = differs | self._flips
        elif self._may_flip:
            bits = flip_bit(lax.convert_element_type(number, jnp.int32), self._fault)
            bits = _fitted(kind, bits)
            value = jnp.where(self._flips, lax.convert_element_type(bits, number.dtype), value)
            differs = value != number
        return value, differs

    def slot_after(self, changed: Scalar) -> SlotState:
        """Return the slot's state after this tick. changed: bool, the fault changed a bit."""
        slot, tick = self._slot, self._tick
        return replace(
            slot,
            latched=jnp.where(self.hit & self._latches, self._y, slot.latched),
            before=jnp.where(
                self._here & (~slot.active | (slot.before != slot.before)), self._x, slot.before
            ),
            first_tick=first_tick(tick, changed, slot.first_tick),
            last_tick=jnp.where(changed, tick, slot.last_tick),
            changed_ticks=slot.changed_ticks + as_int(changed),
        )


# --- sites ---

Path = tuple[str | int, ...]
ChannelKey = tuple[str, str, str]
"""(site, arm or "", channel)."""
Target = tuple[Path, str]
"""Path of a channel in the signal of its site, and the channel's number type."""


def channel_keys(setup: Setup) -> tuple[ChannelKey, ...]:
    """Return all channels with faults. The code of a fault is the index of its channel plus 1."""
    return tuple(
        (use.site, arm, channel) for use in setup.injection.sites for arm, channel in use.channels
    )


def read_channel(signal: Any, path: Path) -> Scalar:
    """Return the number at `path` of a site's signal."""
    for step in path:
        signal = getattr(signal, step) if isinstance(step, str) else signal[step]
    return signal


def write_channel(signal: Any, path: Path, value: Scalar) -> Any:
    """Return a copy of a site's signal with `value` at `path`."""
    if not path:
        return value
    step, rest = path[0], path[1:]
    if isinstance(step, str):
        return replace(signal, **{step: write_channel(getattr(signal, step), rest, value)})
    items = list(signal)
    items[step] = write_channel(items[step], rest, value)
    return Vec(items) if isinstance(signal, Vec) else tuple(items)


def _store(kind: str, y: Scalar, old: Scalar) -> Scalar:
    """Convert `y` (float) to the channel's type. A number beyond int32 becomes -2147483648."""
    if kind == "float":
        return lax.convert_element_type(y, old.dtype)
    if kind == "bool":
        return lax.convert_element_type(y != 0.0, old.dtype)
    return lax.convert_element_type(_fitted(kind, to_int32(y)), old.dtype)


def _fitted(kind: str, whole: Scalar) -> Scalar:
    if kind == "int16":
        return wrap16(whole)
    return jnp.minimum(jnp.maximum(whole, -32768), 32767) if kind == "int16 saturated" else whole


@dataclasses.dataclass(eq=False)
class Injector:
    """Injects faults in one tick: call it with each site and its signal, in order."""

    setup: Any  # a setup of the robot's class
    # Path in its site's signal and kind of each channel of `channel_keys`; the kinds are "int16",
    # "int16 saturated", "int32", "float" and "bool".
    paths: Mapping[ChannelKey, Target]
    faults: Faults
    state: FaultState
    clock: TriggerClocks

    def strikes(self, *sites: str) -> bool:
        """Return whether the campaign injects faults at any of these sites."""
        return injects_faults(self.setup, *sites)

    def strike_parameters(self, params: Any) -> Any:
        """Return the parameters of the tick after faults: each channel is the path of a number."""
        keys = [key for key in channel_keys(self.setup) if key[0] == PARAMETER]
        given = [paths.named_numbers(params, self.setup, name)[name] for _, _, name in keys]
        numbers = Vec(map(jnp.asarray, given))
        for i, (key, number) in enumerate(zip(keys, numbers, strict=True)):
            # The kind of a parameter's number is known only here.
            kind = "float" if jnp.issubdtype(number.dtype, jnp.floating) else "int32"
            self.paths = {**self.paths, key: ((i,), kind)}
        for key, number in zip(keys, self(PARAMETER, numbers), strict=True):
            params = paths.assign_numbers(params, self.setup, key[2], number)
        return params

    def __call__(self, site: str, signal: Any, present: Scalar = True) -> Any:
        """Return the signal of a site with its faults. present: bool, the signal exists."""
        keys = channel_keys(self.setup)
        for use in self.setup.injection.sites:
            if use.site != site:
                continue
            targets = [(i + 1, *self.paths[key]) for i, key in enumerate(keys) if key[0] == site]
            slots = list(self.state.slots)
            for i, fault in enumerate(self.faults.slots):
                slots[i], signal = self._strike(use, targets, fault, slots[i], signal, present)
            self.state = FaultState(tuple(slots))
        return signal

    def _strike(
        self,
        use: SiteUse,
        targets: list[tuple[int, Path, str]],
        fault: FaultSlot,
        slot: SlotState,
        signal: Any,
        present: Scalar,
    ) -> tuple[SlotState, Any]:
        """Apply one fault slot at one site. Return the slot's state and the signal.

        targets: (code, path, number type) of the site's channels.
        """
        real, tick = self.setup.precision.real, self.clock.tick
        numbers = [jnp.asarray(read_channel(signal, path)) for _, path, _ in targets]
        aims = [fault.code == code for code, _, _ in targets]
        x = lax.convert_element_type(numbers[0], real)
        here = aims[0]
        for aim, number in zip(aims[1:], numbers[1:], strict=True):
            x = jnp.where(aim, lax.convert_element_type(number, real), x)
            here = here | aim
        strike = Strike(use.effects, fault, slot, x, tick, here, present)
        changed = jnp.bool_(False)
        for aim, number, (_, path, kind) in zip(aims, numbers, targets, strict=True):
            value, differs = strike.replacement(kind, number)
            changed = changed | (strike.hit & aim & differs)
            signal = write_channel(signal, path, jnp.where(strike.hit & aim, value, number))
        return strike.slot_after(changed), signal


def injects_faults(setup: Setup, *sites: str) -> bool:
    """Return whether the campaign injects faults at any of these sites."""
    return any(use.site in sites for use in setup.injection.sites)


@functools.cache
def channel_paths(robot: Robot, setup: Setup) -> dict[ChannelKey, Target]:
    """Return path and number type of each channel with faults, except of parameters."""
    table = {}
    for site, arm, name in (key for key in channel_keys(setup) if key[0] != PARAMETER):
        channel = robot.sites[site].channel(name)
        path = tuple(setup.arms.index(arm) if step == ARM else step for step in channel.path)
        table[site, arm, name] = (path, channel.kind)
    return table
