"""Injects faults into arrays, for example into the observations of any robot or simulator.

    from ravenjax import faults

    fault = faults.Fault("offset", value=0.1, start=100, duration=50)
    state = faults.init(signal, fault)
    for tick in range(1000):
        ...
        signal, state, activated = faults.apply(signal, state, tick, fault)
        state = faults.reset(state, done)

All functions are pure. A signal is an array of any shape, of floats, integers or truth values, from
NumPy, JAX, torch or another library of the array API standard. Results are arrays of the same
library. With JAX the functions work under `jit`, `vmap` and `scan`. Each number of a fault may be
an array that broadcasts against the signal. For a signal [environments, channels], a value
[channels] differs between channels, and a value [environments, 1] between environments. The
arguments `tick`, `clock` and `done` have the leading axes of the signal, such as [environments].

Campaigns compute the effects and times of faults with the same code. As in campaigns, integers and
truth values are converted to float32 and back, except by bit flips.
"""

import dataclasses
import math
from typing import Any

import numpy as np

from ravenjax.errors import UserError, describe_unknown_name
from ravenjax.faults.fault import FaultSlot, SlotState, open_window
from ravenjax.faults.injection import FaultAction
from ravenjax.numbers import lazy
from ravenjax.numbers.counter_random import CHANNEL_STRIDE, random_uniform
from ravenjax.numbers.lazy import call_when_jax_loads, lax, run_eagerly
from ravenjax.numbers.vec import Scalar, as_int, record, where
from ravenjax.vocabulary.effects import EFFECT_CODES, EFFECTS, NETWORK_EFFECTS

__all__ = ["Fault", "State", "apply", "init", "reset"]

# Functions of the library of a signal, whose arrays may have any type.
jnp: Any = lazy.jnp

ENDLESS = 2**31 - 1
"""Duration of a fault that never ends, ticks."""
_EFFECTS = (*(name for name in EFFECTS if name not in NETWORK_EFFECTS), "delay")
_UNUSED_VALUES = {"value": 0, "every": 0, "period": 1, "key": 0}
"""Values of arguments that a fault does not use."""


@dataclasses.dataclass(frozen=True, eq=False)
class Fault:
    """A fault: its effect on a signal, and when it acts. In JAX it is a pytree, whose field
    `effect` is static.

    effect: as in a campaign's `[[group.fault]]`. Of the network effects only "delay" is available.
    value: number that the effect uses, in the signal's unit; for "delay", the delay in ticks.

    The fault acts from `start` ticks after the reset for `duration` ticks, and again every `every`
    ticks. With `probability` it acts at random times after `start`: in each tick an inactive fault
    begins with this probability, and then acts for `duration` ticks. period: ticks, only for the
    effect "periodic".

    key: int32, selects the random numbers of `probability` and of the effect "random". Elements
    with the same key become faulty at the same time, but "random" gives each element different
    numbers. at: bool, elements on which the fault may act.

    Raise UserError, a ValueError, for an unknown effect, and for missing, unused or wrong numbers.
    """

    effect: str
    value: Any = None
    start: Any = 0
    duration: Any = ENDLESS
    every: Any = None
    probability: Any = None
    period: Any = None
    key: Any = None
    at: Any = True

    def __post_init__(self) -> None:
        if self.effect not in _EFFECTS:
            raise UserError(describe_unknown_name("effect", self.effect, _EFFECTS))
        self._require_arguments()
        times = "duration", "every", "period"
        limits: dict[str, tuple[float, float]] = dict.fromkeys(times, (1, ENDLESS))
        limits |= {"start": (0, ENDLESS), "probability": (0, 1)}
        if self.effect == "bit_flip":
            limits["value"] = (0, 31)
        elif self.effect == "delay":
            limits["value"] = (0, ENDLESS)
        for name, (low, high) in limits.items():
            # Numbers that are traced or on a device are not checked.
            if isinstance(getattr(self, name), int | float | list | tuple | np.ndarray):
                for number in np.ravel(getattr(self, name)).tolist():
                    if not low <= number <= high:
                        raise UserError(f"{name} is {number}, expected {low} to {high}")

    def _require_arguments(self):
        # Raises UserError for an argument that is missing, or that the fault does not use.
        is_random = self.probability is not None
        needs = {
            "value": EFFECTS[self.effect].takes_value,
            "period": self.effect == "periodic",
            "key": self.effect == "random" or is_random,
        }
        for name, is_needed in needs.items():
            is_given = getattr(self, name) is not None
            if is_given != is_needed:
                words = f"effect {self.effect}{' and a probability' if is_random else ''}"
                raise UserError(
                    f"a fault with {words} {'needs' if is_needed else 'takes no'} {name}"
                )
        if is_random and self.every is not None:
            raise UserError("a fault takes 'probability' or 'every', not both: remove one of them")


call_when_jax_loads(
    lambda jax: jax.tree_util.register_dataclass(
        Fault,
        data_fields=[field.name for field in dataclasses.fields(Fault)[1:]],
        meta_fields=["effect"],
    )
)


@record
class State:
    """The state of one fault on one signal. Its arrays have the signal's shape."""

    # Whether the fault acts, and when it changed the signal since the reset: first_tick and
    # last_tick (-1: never), changed_ticks.
    slot: SlotState
    began: Scalar  # int32, tick of the first call since the reset; -1: no call
    history: tuple[Scalar, ...]  # signals of earlier ticks, newest first, for effect delay


def init(signal: Any, fault: Fault) -> State:
    """Return the state before the first tick. Only the shape and type of `signal` are used.

    If the effect is "delay", JAX must not trace `fault.value`: it is the length of the history.
    """
    with run_eagerly(signal) as signal:
        longest_delay = 0
        if fault.effect == "delay":
            longest_delay = int(jnp.max(jnp.asarray(fault.value, dtype=jnp.int32)))
        _, real = _number_types(signal)
        return _initial_state(signal.shape, real, (signal,) * longest_delay)


def reset(state: State, done: Any) -> State:
    """Reset the environments that are `done` (bool) to the state before their first tick."""
    # `latched` has the signal's shape and its library, such as NumPy. Its type is that of floats.
    latched = state.slot.latched
    with run_eagerly(latched):
        start = _initial_state(latched.shape, latched.dtype, state.history)
        return where(_broadcast_leading("done", done, latched.shape) != 0, start, state)


def apply(
    signal: Any, state: State, tick: Any, fault: Fault, clock: Any = None
) -> tuple[Any, State, Any]:
    """Return the signal with the fault, the new state, and which elements changed a bit (bool).

    Call this function once in each tick. tick: int, counts all ticks and is not reset. clock: int,
    time with which `start` is compared, such as ticks since a trigger; while it is negative, the
    fault does not act. None: ticks since the reset.
    """
    with np.errstate(all="ignore"), run_eagerly(signal) as signal:
        shape, (kind, real) = signal.shape, _number_types(signal)

        def argument(name: str, dtype: Any = jnp.int32) -> Any:
            # Returns an argument of the fault as an array of the signal's shape.
            given = getattr(fault, name)
            return _broadcast(name, _UNUSED_VALUES[name] if given is None else given, shape, dtype)

        tick = _broadcast_leading("tick", tick, shape)
        is_first_call = state.began < 0
        began = jnp.where(is_first_call, tick, state.began)
        reading = tick - began if clock is None else _broadcast_leading("clock", clock, shape)
        effect, history = fault.effect, state.history
        if effect == "delay":
            # A delay overwrites the signal with a signal of an earlier tick. Newest first.
            past = signal, *(jnp.where(is_first_call, signal, old) for old in history)
            effect, history, value = "overwrite", past[:-1], signal
            for ticks, old in enumerate(past):
                value = jnp.where(argument("value") == ticks, old, value)
            value = lax.convert_element_type(value, real)
        else:
            value = argument("value", real)
        # Each element has its own random numbers for the effect.
        element = jnp.reshape(jnp.arange(math.prod(shape)), shape)
        key = lax.convert_element_type(argument("key"), jnp.uint32)
        element = lax.convert_element_type(element, jnp.uint32)
        at, element_key = argument("at"), key + element * jnp.uint32(CHANNEL_STRIDE)
        times = (argument(name) for name in ("start", "duration", "every", "period"))
        slot = FaultSlot(at, at * EFFECT_CODES[effect], value, tick, *times, key=element_key)
        since_start = reading - slot.start
        if fault.probability is not None:
            # The time since the last random start, or -1 if the fault does not act.
            next_age = state.slot.age + 1
            continues = state.slot.active & (next_age < slot.duration)
            begins = random_uniform(key, tick, 1) < argument("probability", jnp.float32)
            since_random_start = jnp.where(continues, next_age, as_int(begins) - 1)
            since_start = jnp.where(since_start < 0, -1, since_random_start)
        opened = open_window(slot, state.slot, since_start)
        x = lax.convert_element_type(signal, real)
        action = FaultAction((effect,), slot, opened, x, tick, on_channel=at > 0, present=True)
        value, differs = action.replacement(kind, signal)
        activated = action.acts & differs
        faulty_signal = jnp.where(action.acts, value, signal)
        return faulty_signal, State(action.slot_after(activated), began, history), activated


def _number_types(signal: Any) -> tuple[str, Any]:
    """Return the kind of number of the signal, and the float type in which faults are computed."""
    name = str(signal.dtype)
    if "float" in name:
        return "float", signal.dtype
    if "int" not in name and "bool" not in name:
        raise UserError(f"signal has type {name}, expected floats, integers or truth values")
    return "int32" if "int" in name else "bool", jnp.float32


def _initial_state(shape: tuple[int, ...], real: Any, history: tuple[Any, ...]) -> State:
    # Returns the state before the first tick: the fault does not act, and no signal is known.
    def filled(x: float, dtype: Any = jnp.int32) -> Any:
        return jnp.broadcast_to(jnp.asarray(x, dtype=dtype), shape)

    active, age, changed_ticks = filled(0) > 0, filled(0), filled(0)
    latched, before = filled(0.0, real), filled(math.nan, real)
    # Each field has its own array, so that JAX can donate the state.
    slot = SlotState(active, age, latched, before, filled(-1), changed_ticks, filled(-1))
    return State(slot, began=filled(-1), history=history)


def _broadcast_leading(name: str, x: Any, shape: tuple[int, ...]) -> Any:
    """Return numbers for the signal's leading axes ([environments]) as int32 of its whole shape."""
    x = jnp.asarray(x, dtype=jnp.int32)
    ones = (1,) * (len(shape) - x.ndim)
    return _broadcast(name, jnp.reshape(x, (*x.shape, *ones)), shape, jnp.int32)


def _broadcast(name: str, x: Any, shape: tuple[int, ...], dtype: Any) -> Any:
    # Returns the argument `name` as an array of the signal's shape.
    x = jnp.asarray(x, dtype=dtype)
    try:
        return jnp.broadcast_to(x, shape)
    except (TypeError, ValueError, RuntimeError) as error:
        got = tuple(x.shape)
        message = f"{name} has shape {got}, expected one that broadcasts to the signal's {shape}"
        raise UserError(message) from error
