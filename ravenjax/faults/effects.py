"""What a fault does to a number: one function an effect. Knows nothing of any robot."""

from __future__ import annotations

import math
from collections.abc import Callable

from ravenjax.faults.fault import FaultSlot, SlotState
from ravenjax.numbers.counter_random import uniform
from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.vec import Scalar, to_int32
from ravenjax.vocabulary.effects import EFFECT_CODES

Effect = Callable[[Scalar, FaultSlot, SlotState, Scalar], Scalar]
"""(x, fault, slot, tick) -> the float that takes x's place; whole numbers have their bits
flipped by `flipped`.
"""


def flipped(x: Scalar, fault: FaultSlot) -> Scalar:
    """An int32 with the fault's bit inverted."""
    return x ^ lax.shift_left(jnp.int32(1), to_int32(fault.value) & 31)


def _bit_flip(x: Scalar, fault: FaultSlot, slot: SlotState, tick: Scalar) -> Scalar:
    pattern = lax.bitcast_convert_type(lax.convert_element_type(x, jnp.float32), jnp.int32)
    return lax.convert_element_type(
        lax.bitcast_convert_type(flipped(pattern, fault), jnp.float32), x.dtype
    )


def _periodic(x: Scalar, fault: FaultSlot, slot: SlotState, tick: Scalar) -> Scalar:
    period = jnp.maximum(fault.period, 1)
    phase = lax.rem(slot.age, period)
    turn = lax.convert_element_type(phase, x.dtype) / lax.convert_element_type(period, x.dtype)
    return x + fault.value * jnp.sin(2.0 * math.pi * turn)


def _random(x: Scalar, fault: FaultSlot, slot: SlotState, tick: Scalar) -> Scalar:
    return fault.value * (
        2.0 * lax.convert_element_type(uniform(fault.key, tick, 0), x.dtype) - 1.0
    )


_EFFECTS: dict[str, Effect] = {
    "overwrite": lambda x, fault, slot, tick: fault.value,
    "offset": lambda x, fault, slot, tick: x + fault.value,
    "latch_offset": lambda x, fault, slot, tick: jnp.where(
        slot.age == 0, x + fault.value, slot.latched
    ),
    "scale": lambda x, fault, slot, tick: x * fault.value,
    "drift": lambda x, fault, slot, tick: (
        x + fault.value * lax.convert_element_type(slot.age + 1, x.dtype)
    ),
    # A window that is open from the first tick on has nothing before it and holds that tick's
    # number.
    "stuck": lambda x, fault, slot, tick: jnp.where(slot.before == slot.before, slot.before, x),
    "bit_flip": _bit_flip,
    "periodic": _periodic,
    "random": _random,
    "toggle": lambda x, fault, slot, tick: jnp.where((slot.age & 1) == 0, fault.value, 0.0),
}


def apply(
    effects: tuple[str, ...], x: Scalar, fault: FaultSlot, slot: SlotState, tick: Scalar
) -> Scalar:
    """The number that takes the place of `x` (float), by the fault's effect, one of `effects`."""
    result = _EFFECTS[effects[0]](x, fault, slot, tick)
    for name in effects[1:]:
        result = jnp.where(
            fault.effect == EFFECT_CODES[name], _EFFECTS[name](x, fault, slot, tick), result
        )
    return lax.convert_element_type(result, x.dtype)
