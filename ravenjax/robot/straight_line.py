"""Straight-line programs: an expression graph that folds constants and shares what is equal.

Formulas are written once on `Term`s with `+ - *`, `sin` and `cos`. The graph drops zeros and ones, pulls signs out of
products, merges equal subexpressions and keeps only what an output needs, so generic code (rigid-body recursions over
any tree) ends as the short list of scalar operations that a hand derivation would give. `Program` then replays that
list on any kind of number.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import jax.numpy as jnp

from ravenjax.types import Scalar


class Graph:
    """Hash-consed operations; node number -> (operation, operand, operand)."""

    def __init__(self) -> None:
        self.nodes: list[tuple] = []
        self._numbers: dict[tuple, int] = {}

    def node(self, *key) -> Term:
        if key not in self._numbers:
            self._numbers[key] = len(self.nodes)
            self.nodes.append(key)
        return Term(self, self._numbers[key], 1)

    def input(self, position: int) -> Term:
        return self.node("input", position, 0)


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Term:
    """A signed node of a graph. Arithmetic with a Python number, or between terms of one graph."""

    graph: Graph
    number: int
    sign: int

    def __neg__(self) -> Term:
        return Term(self.graph, self.number, -self.sign)

    def __add__(self, other: Term | float) -> Term | float:
        if not isinstance(other, Term):
            return self if other == 0.0 else self._shifted(float(other))
        a, b = (self, other) if self.number <= other.number else (other, self)
        if a.number == b.number:
            return 0.0 if a.sign != b.sign else a * 2.0
        shared = self._shared_factor(a, b)
        if shared is not None:
            return shared
        if a.sign == b.sign:
            total = self.graph.node("add", a.number, b.number)
        else:
            total = self.graph.node("sub", a.number, b.number)
        return total if a.sign > 0 else -total

    __radd__ = __add__

    def __sub__(self, other: Term | float) -> Term | float:
        return self + (-other)

    def __rsub__(self, other: float) -> Term | float:
        return (-self) + other

    def __mul__(self, other: Term | float) -> Term | float:
        if not isinstance(other, Term):
            return self._scaled(float(other))
        if self.number == other.number:
            product = self.graph.node("mul", self.number, self.number)
        else:
            product = self.graph.node("mul", *sorted((self.number, other.number)))
        return product if self.sign == other.sign else -product

    __rmul__ = __mul__

    def _scaled(self, factor: float) -> Term | float:
        if factor == 0.0:
            return 0.0
        sign = self.sign if factor > 0 else -self.sign
        number, size = self.number, abs(factor)
        operation = self.graph.nodes[number]
        if operation[0] == "scale":  # c (d x) = (c d) x
            number, size = operation[1], size * operation[2]
        if size == 1.0:
            return Term(self.graph, number, sign)
        return Term(self.graph, self.graph.node("scale", number, size).number, sign)

    def _shifted(self, offset: float) -> Term:
        shifted = self.graph.node("shift", self.number, offset * self.sign)
        return shifted if self.sign > 0 else -shifted

    @staticmethod
    def _shared_factor(a: Term, b: Term) -> Term | float | None:
        """c x + c y = c (x + y), for a constant c."""
        graph = a.graph
        one, two = graph.nodes[a.number], graph.nodes[b.number]
        if one[0] == two[0] == "scale" and one[2] == two[2]:
            return (Term(graph, one[1], a.sign) + Term(graph, two[1], b.sign)) * one[2]
        return None


Number = Term | float


def sin(x: Number) -> Number:
    """Sine of a term or Python number."""
    if not isinstance(x, Term):
        return math.sin(x)
    return x.graph.node("sin", x.number, 0) if x.sign > 0 else -x.graph.node("sin", x.number, 0)


def cos(x: Number) -> Number:
    """Cosine of a term or Python number."""
    return x.graph.node("cos", x.number, 0) if isinstance(x, Term) else math.cos(x)


_REPLAY: dict[str, Callable] = {
    "add": lambda value, a, b: value[a] + value[b],
    "sub": lambda value, a, b: value[a] - value[b],
    "mul": lambda value, a, b: value[a] * value[b],
    "scale": lambda value, a, factor: value[a] * factor,
    "shift": lambda value, a, offset: value[a] + offset,
    "sin": lambda value, a, _: jnp.sin(value[a]),
    "cos": lambda value, a, _: jnp.cos(value[a]),
}
_OPERANDS = {"input": 0, "add": 2, "sub": 2, "mul": 2, "scale": 1, "shift": 1, "sin": 1, "cos": 1}


class Program:
    """The operations that `outputs` need, in order. Call it with the numbers of the inputs."""

    def __init__(self, outputs: Sequence[Number]) -> None:
        self.outputs = tuple(outputs)
        graph = next((term.graph for term in self.outputs if isinstance(term, Term)), Graph())
        needed: set[int] = set()
        pending = [term.number for term in self.outputs if isinstance(term, Term)]
        while pending:
            number = pending.pop()
            if number not in needed:
                needed.add(number)
                operation, *operands = graph.nodes[number]
                pending.extend(operands[: _OPERANDS[operation]])
        self.steps = tuple((number, *graph.nodes[number]) for number in sorted(needed))

    @property
    def operations(self) -> dict[str, int]:
        """How often each operation occurs; a sign left on an output counts as "neg"."""
        count: dict[str, int] = {}
        for _, operation, *_ in self.steps:
            if operation != "input":
                count[operation] = count.get(operation, 0) + 1
        signs = sum(isinstance(term, Term) and term.sign < 0 for term in self.outputs)
        return {**count, "neg": signs} if signs else count

    def __call__(self, inputs: Sequence[Scalar]) -> tuple[Scalar, ...]:
        value: dict[int, Scalar] = {}
        for number, operation, a, b in self.steps:
            value[number] = inputs[a] if operation == "input" else _REPLAY[operation](value, a, b)
        return tuple(_signed(value, term) for term in self.outputs)


def _signed(value: dict[int, Scalar], term: Number) -> Scalar:
    if not isinstance(term, Term):
        return term
    return value[term.number] if term.sign > 0 else -value[term.number]
