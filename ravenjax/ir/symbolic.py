"""Writes formulas as programs, simplified by the algebra of real numbers.

A formula is written on `Term`s with `+ - *`, `sin` and `cos`. Additions of 0 and multiplications by
0 and 1 are removed, signs are moved out of products, and constant factors are multiplied. A program
contains only the operations that an output needs. Generic code, such as a recursion over a tree of
rigid bodies, thus becomes the short formulas that a derivation by hand would give.
"""

from __future__ import annotations

import dataclasses
import operator
from collections.abc import Sequence
from typing import Any

from ravenjax.ir.builder import Builder
from ravenjax.ir.program import Operation, Program
from ravenjax.numbers import jnp, trigonometry

_REAL = "float64"


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Term:
    """A signed operation, for arithmetic with Python numbers and terms of the same builder."""

    builder: Builder
    number: int
    sign: int = 1

    def __neg__(self) -> Term:
        return Term(self.builder, self.number, -self.sign)

    def __add__(self, other: Term | float) -> Term | float:
        # Returns the sum, simplified where the terms are 0, equal, or have a common factor.
        if not isinstance(other, Term):
            if other == 0.0:
                return self
            return self._operation("add", self._constant(other * self.sign), self.sign)
        a, b = (self, other) if self.number <= other.number else (other, self)
        if a.number == b.number:
            return 0.0 if a.sign != b.sign else a * 2.0
        (x, c), (y, d) = a._factor(), b._factor()
        # c x + c y = c (x + y)
        if c is not None and c == d:
            return (x + y) * c
        # The signs are in the terms: -x - y is -(x + y), and -x + y is -(x - y).
        return a._operation("add" if a.sign == b.sign else "sub", b.number, a.sign)

    __radd__ = __add__

    def __sub__(self, other: Term | float) -> Term | float:
        return self + (-other)

    def __rsub__(self, other: float) -> Term | float:
        return (-self) + other

    def __mul__(self, other: Term | float) -> Term | float:
        # Returns the product, with constant factors merged.
        if isinstance(other, Term):
            return self._operation("mul", other.number, self.sign * other.sign)
        if other == 0.0:
            return 0.0
        term, factor = self._factor()
        # c (d x) = (c d) x
        size = abs(other) * (factor or 1.0)
        sign = term.sign if other > 0 else -term.sign
        if size == 1.0:
            return Term(self.builder, term.number, sign)
        return term._operation("mul", self._constant(size), sign)

    __rmul__ = __mul__

    def _operation(self, name: str, operand: int, sign: int) -> Term:
        return Term(self.builder, self.builder.emit(name, _REAL, self.number, operand), sign)

    def _constant(self, value: float) -> int:
        return self.builder.constant(_REAL, value)

    def _factor(self) -> tuple[Term, float | None]:
        """Return (x, c) if this term is a product c x with a constant c > 0, else (self, None)."""
        # All constants of products are positive, because `__mul__` moves their signs to `sign`.
        operation = self.builder.operations[self.number]
        if operation.name == "mul":
            for factor, other in (operation.operands, operation.operands[::-1]):
                if (constant := self.builder.constants.get(factor)) is not None:
                    return Term(self.builder, other, self.sign), float(constant)
        return self, None


Number = Term | float


def make_symbols(count: int) -> list[Term]:
    """Return the inputs of a new program."""
    builder = Builder()
    return [Term(builder, builder.input(_REAL)) for _ in range(count)]


def sin(x: Number) -> Number:
    """Return the sine of a term or Python number."""
    if not isinstance(x, Term):
        return trigonometry.sin(x)
    return Term(x.builder, x.builder.emit("sin", _REAL, x.number), x.sign)


def cos(x: Number) -> Number:
    """Return the cosine of a term or Python number."""
    if not isinstance(x, Term):
        return trigonometry.cos(x)
    return Term(x.builder, x.builder.emit("cos", _REAL, x.number))


def build_program(inputs: Sequence[Term], outputs: Sequence[Number]) -> Program:
    """Return the program from the terms of `make_symbols` to the outputs."""
    builder = inputs[0].builder

    def signed_number(x):
        # Returns the number of an operation whose result is x. A sign becomes an operation here.
        if not isinstance(x, Term):
            return builder.constant(_REAL, x)
        return x.number if x.sign > 0 else builder.emit("neg", _REAL, x.number)

    return builder.program([signed_number(x) for x in outputs])


def replay_program(program: Program, inputs: Sequence[Any]) -> list[Any]:
    """Return the results of a program of `build_program`, on numbers or on JAX's tracers."""

    def apply(operation: Operation, *operands):
        name = operation.name
        if name == "input":
            return inputs[operation.detail]
        if name == "constant":
            return float(operation.value)
        return getattr(jnp if name in ("sin", "cos") else operator, name)(*operands)

    return program.replay(apply)
