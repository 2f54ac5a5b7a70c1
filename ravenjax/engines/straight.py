"""A straight-line program: numbered operations on single numbers, each written once. What the printers print.

Operations have the names and meanings of `meaning`; besides those, `input` is a number from outside (`detail`: which),
`constant` one that is known (`detail`: its bits), and `lookup` reads a 1-D table at one index (`detail`: which table).
A `Builder` never writes the same operation twice, folds constants, and simplifies where that changes no bit.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.engines import meaning, simplify

TYPES = ("bool", "int32", "uint32", "float32", "float64")
COMMUTATIVE = frozenset(("add", "mul", "and", "or", "xor", "eq", "ne"))


class Operation(NamedTuple):
    """One operation; operands are the numbers of earlier ones."""

    name: str
    dtype: str
    operands: tuple[int, ...] = ()
    detail: Any = None


@dataclasses.dataclass(frozen=True)
class Program:
    """Operations in an order in which they can be run, and which of them are the results."""

    operations: tuple[Operation, ...]
    inputs: tuple[str, ...]  # types
    outputs: tuple[int, ...]
    tables: tuple[tuple[str, int], ...] = ()  # types and lengths
    origins: tuple[str, ...] = ()  # where each operation comes from, if that was asked for

    def needed(self, outputs: Iterable[int] | None = None) -> list[int]:
        """The operations that `outputs` (all, by default) depend on, in order."""
        wanted = bytearray(len(self.operations))
        for i in self.outputs if outputs is None else outputs:
            wanted[i] = 1
        for i in range(len(self.operations) - 1, -1, -1):
            if wanted[i]:
                for operand in self.operations[i].operands:
                    wanted[operand] = 1
        return [i for i, w in enumerate(wanted) if w]

    def evaluate(self, inputs: Sequence[Any], tables: Sequence[np.ndarray] = ()) -> list[Any]:
        """Results on NumPy numbers or arrays of one shape."""
        values: dict[int, Any] = {}
        for i in self.needed():
            name, dtype, operands, detail = self.operations[i]
            if name == "input":
                values[i] = np.asarray(inputs[detail], dtype)[()]
            elif name == "constant":
                values[i] = number(dtype, detail)
            elif name == "lookup":
                values[i] = tables[detail][values[operands[0]]]
            else:
                values[i] = meaning.evaluate(name, dtype, tuple(values[o] for o in operands))
        return [values[i] for i in self.outputs]


def bits(dtype: str, value: Any) -> int:
    """The bit pattern of a number."""
    stored = np.asarray(value, dtype)
    return int(stored.view(f"u{stored.dtype.itemsize}"))


def number(dtype: str, pattern: int) -> Any:
    """The number of a bit pattern."""
    return np.asarray(pattern, f"u{np.dtype(dtype).itemsize}").view(dtype)[()]


class Builder:
    """Writes a program."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self.known: dict[int, Any] = {}  # constants: operation -> NumPy number
        self.inputs: list[str] = []
        self.tables: list[tuple[str, int]] = []
        self.origin = ""
        self.origins: list[str] = []
        self._numbers: dict[Operation, int] = {}

    def input(self, dtype: str) -> int:
        """The next number from outside."""
        self.inputs.append(dtype)
        return self._write(Operation("input", dtype, (), len(self.inputs) - 1))

    def table(self, dtype: str, length: int) -> int:
        """The next table; its number."""
        self.tables.append((dtype, length))
        return len(self.tables) - 1

    def constant(self, dtype: str, value: Any) -> int:
        """A known number."""
        pattern = bits(dtype, value)
        i = self._write(Operation("constant", dtype, (), pattern))
        if i not in self.known:
            self.known[i] = number(dtype, pattern)
        return i

    def emit(self, name: str, dtype: str, *operands: int) -> int:
        """The number of an operation's result."""
        known = self.known
        if all(o in known for o in operands):
            return self.constant(dtype, meaning.evaluate(name, dtype, tuple(known[o] for o in operands)))
        if name in COMMUTATIVE and operands[0] > operands[1]:
            operands = (operands[1], operands[0])
        simpler = simplify.simplify(self, name, dtype, operands)
        return self._write(Operation(name, dtype, operands)) if simpler is None else simpler

    def lookup(self, table: int, index: int) -> int:
        """The number of `table` at `index`, which must be inside."""
        return self._write(Operation("lookup", self.tables[table][0], (index,), table))

    def program(self, outputs: Sequence[int]) -> Program:
        """What was written."""
        return Program(
            tuple(self.operations), tuple(self.inputs), tuple(outputs), tuple(self.tables), tuple(self.origins)
        )

    def _write(self, operation: Operation) -> int:
        found = self._numbers.get(operation)
        if found is None:
            found = self._numbers[operation] = len(self.operations)
            self.operations.append(operation)
            self.origins.append(self.origin)
        return found


def rewrite(program: Program, change: Callable[[Builder, int, tuple[int, ...]], int | None]) -> Program:
    """`program` written anew, without what no result needs.

    change(builder, i, operands) may give another result for operation `i`; None copies it.
    """
    builder = Builder()
    builder.inputs, builder.tables = list(program.inputs), list(program.tables)
    new: dict[int, int] = {}
    for i in program.needed():
        name, dtype, operands, detail = program.operations[i]
        builder.origin = program.origins[i]
        moved = tuple(new[o] for o in operands)
        changed = change(builder, i, moved)
        if changed is not None:
            new[i] = changed
        elif name == "constant":
            new[i] = builder.constant(dtype, number(dtype, detail))
        elif name in ("input", "lookup"):
            new[i] = builder._write(Operation(name, dtype, moved, detail))
        else:
            new[i] = builder.emit(name, dtype, *moved)
    return builder.program([new[i] for i in program.outputs])


def contract(program: Program) -> Program:
    """Each sum with a product becomes one `fma`: fewer operations and roundings, on every engine alike.

    Whether it does depends on nothing else that the program computes, so that what is left out changes no bit.
    """

    def fused(builder: Builder, i: int, operands: tuple[int, ...]) -> int | None:
        name, dtype, _, _ = program.operations[i]
        if name not in ("add", "sub") or dtype not in ("float32", "float64"):
            return None
        for k in (0, 1):
            product, c = builder.operations[operands[k]], operands[1 - k]
            if product.name == "mul":
                x, y = product.operands
                if name == "sub" and k == 0:
                    c = builder.emit("neg", dtype, c)
                elif name == "sub":
                    x = builder.emit("neg", dtype, x)
                return builder.emit("fma", dtype, x, y, c)
        return None

    return rewrite(program, fused)
