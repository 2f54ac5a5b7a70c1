"""`jnp` and `lax` for code of a tick that writes its program itself: the functions that ticks call,
and no others.

Each writes what JAX's function of that name is lowered to. Any other name, type or argument is
refused with `Untraceable`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np

from ravenjax.ir import compounds, polynomials
from ravenjax.ir import traced_number as number
from ravenjax.ir.builder import Builder
from ravenjax.ir.traced_number import (
    BOOL,
    DTYPES,
    FLOAT,
    INT,
    UINT,
    WEAK_FLOAT,
    TracedNumber,
    refused,
)
from ravenjax.numbers import tree


class NumberType:
    """A type of numbers: a name for it, and a function that makes one."""

    def __init__(self, builder: Builder, kind: int) -> None:
        self._builder, self._kind = builder, kind
        self.name = DTYPES[kind]
        self.dtype = np.dtype(self.name)  # so that a number's dtype equals it, as it does JAX's

    def __eq__(self, other: Any) -> bool:
        """As JAX's: it equals NumPy's type of that name."""
        return self is other or self.dtype.type == other

    def __hash__(self) -> int:
        return hash(self.dtype.type)

    def __call__(self, x: Any) -> TracedNumber:
        if (
            type(x) is int and self._kind == UINT and 0 <= x < 2**32
        ):  # the only way to write so large a number
            return TracedNumber(self._builder, None, UINT, x)
        return number.convert(self._builder, x, self._kind)


def _check_float(name: str, kind: int) -> None:
    if kind not in (FLOAT, WEAK_FLOAT):
        raise refused(f"{name} of anything but floats")


class TracedNumpy:
    """What stands for `jax.numpy`."""

    inf, nan, pi = math.inf, math.nan, math.pi

    def __init__(self, builder: Builder) -> None:
        self._builder = builder
        self.bool_, self.int32 = NumberType(builder, BOOL), NumberType(builder, INT)
        self.uint32, self.float32 = NumberType(builder, UINT), NumberType(builder, FLOAT)

    def __getattr__(self, name: str) -> Callable[..., TracedNumber]:
        if name in polynomials.FUNCTIONS:
            return lambda *x: self._function(name, *x)
        raise refused(f"jnp.{name}")

    def _function(self, name: str, *x: Any) -> TracedNumber:
        indices, kind = number.joined(self._builder, *x)
        _check_float(name, kind)
        arithmetic = polynomials.Arithmetic(self._builder.emit, self._builder.constant)
        return TracedNumber(self._builder, polynomials.write(name, arithmetic, *indices), kind)

    def asarray(self, x: Any, dtype: Any = None) -> TracedNumber:
        """The number, of a type if one is named."""
        return number.operand(self._builder, x) if dtype is None else self._converted(x, dtype)

    def _converted(self, x: Any, dtype: Any) -> TracedNumber:
        return number.convert(self._builder, x, number.kind_of(dtype))

    def zeros_like(self, x: Any) -> TracedNumber:
        """Zero, of the number's type."""
        kind = number.plain_kind(x)
        return TracedNumber(self._builder, None, kind, 0)

    def where(self, condition: Any, yes: Any, no: Any) -> TracedNumber:
        """`yes` or `no`, in the type that both share."""
        b = self._builder
        condition, *sides = (number.operand(b, x) for x in (condition, yes, no))
        if condition.kind != BOOL:
            raise refused("a choice by anything but a truth value")
        condition, *sides = (
            number.written(b, x) for x in (condition, *sides)
        )  # before they are converted, as by JAX
        (i, j), kind = number.joined(b, *sides)
        return TracedNumber(b, b.emit("select", DTYPES[kind], condition.index, i, j), kind)

    def maximum(self, x: Any, y: Any) -> TracedNumber:
        """The larger number."""
        return number.arithmetic(self._builder, "max", x, y)

    def minimum(self, x: Any, y: Any) -> TracedNumber:
        """The smaller number."""
        return number.arithmetic(self._builder, "min", x, y)

    def abs(self, x: Any) -> TracedNumber:
        """The magnitude."""
        return abs(number.operand(self._builder, x))

    def sqrt(self, x: Any) -> TracedNumber:
        """The square root."""
        return self._of_float("sqrt", x)

    def floor(self, x: Any) -> TracedNumber:
        """The next whole number below."""
        return self._of_float("floor", x)

    def round(self, x: Any) -> TracedNumber:
        """The nearest whole number, of two the even one."""
        return self._of_float("round", x)

    def _of_float(self, name: str, x: Any) -> TracedNumber:
        _check_float(name, number.plain_kind(x))
        return number.alone(self._builder, name, x)

    def sign(self, x: Any) -> TracedNumber:
        """-1, 0 or 1."""
        x = number.operand(self._builder, x)
        if x.kind == BOOL:
            raise refused("sign of a truth value")
        return TracedNumber(
            self._builder, compounds.sign(self._builder, DTYPES[x.kind], x.index), x.kind
        )


class TracedLax:
    """What stands for `jax.lax`."""

    def __init__(self, builder: Builder) -> None:
        self._builder = builder

    def __getattr__(self, name: str) -> Any:
        raise refused(f"lax.{name}")

    def convert_element_type(self, x: Any, dtype: Any) -> TracedNumber:
        """The number as one of that type."""
        return number.convert(self._builder, x, number.kind_of(dtype))

    def bitcast_convert_type(self, x: Any, dtype: Any) -> TracedNumber:
        """The number whose bits are the same."""
        b, x, kind = self._builder, number.operand(self._builder, x), number.kind_of(dtype)
        if BOOL in (kind, x.kind):
            raise refused("bits of a truth value")
        return TracedNumber(b, b.emit("bitcast", DTYPES[kind], x.index), kind)

    def div(self, x: Any, y: Any) -> TracedNumber:
        """The quotient, of whole numbers rounded towards zero."""
        return number.arithmetic(self._builder, "div", *self._alike(x, y))

    def rem(self, x: Any, y: Any) -> TracedNumber:
        """What integer division leaves."""
        x, y = self._alike(x, y)
        if number.plain_kind(x) in (FLOAT, WEAK_FLOAT):
            raise refused("the remainder of floats")
        return number.arithmetic(self._builder, "rem", x, y)

    def shift_left(self, x: Any, y: Any) -> TracedNumber:
        """The bits moved up."""
        return number.shift(self._builder, "shl", "shl", *self._alike(x, y))

    def _alike(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Two numbers of one kind, as `lax` asks for."""
        if len({DTYPES[number.plain_kind(one)] for one in (x, y)}) != 1:
            raise refused("a function of lax of numbers of unlike types")
        return x, y

    def cond(self, condition: Any, then: Callable[[], Any], otherwise: Callable[[], Any]) -> Any:
        """Both results, and a choice between each pair of their numbers."""
        b = self._builder
        condition = number.operand(b, condition)
        if condition.kind != BOOL:
            raise refused("a branch on anything but a truth value")
        branch = number.convert(b, condition, INT).index  # as JAX counts branches
        usual = tree.mapped(lambda x: number.written(b, x), otherwise())
        rarely = b.emit("ne", "bool", branch, b.constant("int32", 0))
        rare = then()
        if tree.structure(rare) != tree.structure(usual):
            raise refused("a branch whose results are of unlike structure")

        def choice(yes: Any, no: Any) -> TracedNumber:
            yes, no = number.operand(b, yes), number.operand(b, no)
            if yes.kind != no.kind:  # of a weak one beside another JAX makes a weak one
                raise refused("a branch whose results are of unlike types")
            (i, j), kind = number.joined(b, yes, no)
            return TracedNumber(b, b.emit("rarely", DTYPES[kind], rarely, i, j), kind)

        return tree.mapped(choice, rare, usual)
