"""Writes programs: each operation once (common subexpressions are shared), constants folded, what
is simple shortened.

What the simplifier writes instead gives the same bits (a NaN's payload aside), for every operand
there is.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from ravenjax.ir import semantics, simplify
from ravenjax.ir.program import Operation, Program, bits, number

COMMUTATIVE = frozenset(("add", "mul", "and", "or", "xor", "eq", "ne"))


class Builder:
    """Writes a program."""

    def __init__(self) -> None:
        self.operations: list[Operation] = []
        self.constants: dict[int, Any] = {}  # constants: operation -> NumPy number
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
        if i not in self.constants:
            self.constants[i] = number(dtype, pattern)
        return i

    def emit(self, name: str, dtype: str, *operands: int) -> int:
        """The number of an operation's result."""
        constants = self.constants
        for o in operands:
            if o not in constants:
                break
        else:
            return self.constant(
                dtype, semantics.evaluate(name, dtype, tuple(constants[o] for o in operands))
            )
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
            tuple(self.operations),
            tuple(self.inputs),
            tuple(outputs),
            tuple(self.tables),
            tuple(self.origins),
        )

    def _write(self, operation: Operation) -> int:
        place = self._numbers.get(operation)
        if place is None:
            place = self._numbers[operation] = len(self.operations)
            self.operations.append(operation)
            self.origins.append(self.origin)
        return place


def rewrite(
    program: Program, change: Callable[[Builder, int, tuple[int, ...]], int | None]
) -> Program:
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
    """Each sum with a product becomes one `fma`: fewer operations and roundings, on every engine
    alike.

    Whether it does depends on nothing else that the program computes, so that what is left out
    changes no bit.
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
