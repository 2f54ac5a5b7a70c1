"""Defines the types of numbers in a tick of the simulation: single numbers, vectors and records.

Every quantity of a simulated robot is a *single number*. A `Vec` is a fixed-length tuple of single
numbers with elementwise arithmetic. A `record` is a frozen dataclass of single numbers that is
registered as a JAX pytree. Code in these types reads like the equations, needs no axes, and
compiles to a sequence of scalar operations.
"""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Callable, Iterable, Sequence
from functools import reduce
from typing import Any, TypeAlias, dataclass_transform

from ravenjax.numbers import tree as trees
from ravenjax.numbers.lazy import call_when_jax_loads, jnp, lax

Scalar: TypeAlias = Any
"""One number: a Python number, a NumPy or JAX scalar, or a tracer of one."""


class Vec(tuple[Scalar, ...]):
    """Fixed-length tuple of numbers with elementwise arithmetic; a plain number is broadcast."""

    __slots__ = ()

    def __new__(cls, items: Iterable[Scalar]) -> Vec:
        return super().__new__(cls, items)

    @staticmethod
    def full(length: int, value: Scalar) -> Vec:
        """Return a `Vec` of `length` copies of `value`."""
        return Vec((value,) * length)

    def map(self, function: Callable[..., Scalar], *others: Any) -> Vec:
        """Return `function(self[i], other[i], ...)` for each i. Plain numbers are repeated."""
        columns = [other if isinstance(other, tuple) else (other,) * len(self) for other in others]
        return Vec(function(*items) for items in zip(self, *columns, strict=True))

    def __add__(self, other: Any) -> Vec:  # type: ignore[override]
        return self.map(operator.add, other)

    __radd__ = __add__

    def __sub__(self, other: Any) -> Vec:
        return self.map(operator.sub, other)

    def __rsub__(self, other: Any) -> Vec:
        return self.map(lambda a, b: b - a, other)

    def __mul__(self, other: Any) -> Vec:  # type: ignore[override]
        return self.map(operator.mul, other)

    __rmul__ = __mul__  # type: ignore[assignment]

    def __truediv__(self, other: Any) -> Vec:
        return self.map(operator.truediv, other)

    def __neg__(self) -> Vec:
        return self.map(operator.neg)

    def replace(self, index: int, value: Scalar) -> Vec:
        """Return a copy with `value` at `index`."""
        return Vec((*self[:index], value, *self[index + 1 :]))


call_when_jax_loads(
    lambda jax: jax.tree_util.register_pytree_with_keys(
        Vec,
        lambda vec: ([(jax.tree_util.SequenceKey(i), item) for i, item in enumerate(vec)], None),
        lambda _, items: Vec(items),
    )
)


@dataclass_transform(frozen_default=True, kw_only_default=False)
def record(cls: type) -> type:
    """Class decorator: make the class a frozen dataclass, and register it as a JAX pytree. JAX then
    treats the numbers of its fields as leaves.
    """
    cls = dataclasses.dataclass(frozen=True)(cls)
    names = [field.name for field in dataclasses.fields(cls)]
    call_when_jax_loads(
        lambda jax: jax.tree_util.register_dataclass(cls, data_fields=names, meta_fields=[])
    )
    return cls


replace = dataclasses.replace


def cast(tree: Any, dtype: str) -> Any:
    """Return `tree` with each number rounded to `dtype`."""
    return trees.map_leaves(lambda x: lax.convert_element_type(x, dtype), tree)


INT32_MIN = -2147483648


def to_int32(x: Scalar) -> Scalar:
    """Return C's `(int)x` on x86: truncated toward zero; NaN and overflow give -2147483648."""
    fits = (x >= -2147483648.0) & (x < 2147483648.0)
    # The inner `where` avoids conversions whose result depends on the machine.
    return jnp.where(fits, lax.convert_element_type(jnp.where(fits, x, 0.0), jnp.int32), INT32_MIN)


def wrap16(x: Scalar) -> Scalar:
    """Return the lowest 16 bits of an int32 as a signed number: 32768 gives -32768."""
    return ((x + 32768) & 0xFFFF) - 32768


def as_int(x: Scalar) -> Scalar:
    """Return a truth value or number as int32."""
    return lax.convert_element_type(x, jnp.int32)


def if_rarely(condition: Scalar, then: Callable[[], Any], otherwise: Any) -> Any:
    """Return `then()` if `condition`, which is seldom true, else `otherwise`: records of the same
    structure and types. Generated code skips `then()` in ticks in which no run needs it.
    """
    return lax.cond(condition, then, lambda: otherwise)


def where(condition: Scalar, yes: Any, no: Any) -> Any:
    """Return the record `yes` if the condition is true, else `no`, number by number."""
    return trees.map_leaves(lambda a, b: jnp.where(condition, a, b), yes, no)


def largest(numbers: Iterable[Scalar]) -> Scalar:
    """Return the largest of one or several numbers; NaN if one of them is NaN."""
    return reduce(jnp.maximum, numbers)


def clamp(x: Scalar, low: Scalar, high: Scalar) -> Scalar:
    """Return the nearest number to `x` from `low` to `high`."""
    return jnp.minimum(jnp.maximum(x, low), high)


def number_at(index: Scalar, numbers: Sequence[float]) -> Scalar:
    """Return the number (float32) at an index (int32), which may differ between runs."""
    result = jnp.float32(numbers[0])
    for i, number in enumerate(numbers[1:], start=1):
        result = jnp.where(index == i, jnp.float32(number), result)
    return result


def first_tick(tick: Scalar, occurs: Scalar, before: Scalar) -> Scalar:
    """Return the tick in which an event occurred first; -1: it has not occurred. tick: this tick.
    occurs: bool, the event occurs now. before: the result of the last tick.
    """
    return jnp.where(occurs & (before < 0), tick, before)


def earliest_tick(ticks: list[Scalar]) -> Scalar:
    """Return the earliest of several ticks, of which -1 means never; -1 if all are -1."""
    earliest = ticks[0]
    for tick in ticks[1:]:
        earliest = jnp.where((tick >= 0) & ((earliest < 0) | (tick < earliest)), tick, earliest)
    return earliest
