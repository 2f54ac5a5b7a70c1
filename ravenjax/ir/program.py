"""Defines the intermediate representation from which code for CPUs and GPUs is generated.

A program is a list of operations on single numbers, without loops. Operations have the names of
`semantics`, and three more:

- `input` is a number from outside; `detail` is its index.
- `constant` is a known number; `detail` contains its bits.
- `lookup` reads a 1-D table at one index; `detail` is the number of the table.
"""

import dataclasses
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np

TYPES = ("bool", "int32", "uint32", "float32", "float64")
"""Types that every target supports."""
WIDE_INTEGERS = ("int64", "uint64")


class Operation(NamedTuple):
    """One operation; operands are the numbers of earlier operations."""

    name: str
    dtype: str
    operands: tuple[int, ...] = ()
    detail: Any = None  # of an input, a constant or a lookup, see above

    @property
    def value(self) -> Any:
        """The number of a constant, else None."""
        if self.name != "constant":
            return None
        # `detail` is the bit pattern as an integer: 0x3F800000 of float32 is 1.0.
        return np.asarray(self.detail, f"u{np.dtype(self.dtype).itemsize}").view(self.dtype)[()]


@dataclasses.dataclass(frozen=True)
class Program:
    """Operations in a valid order, and the numbers of those that are the results."""

    operations: tuple[Operation, ...]
    inputs: tuple[str, ...]  # types
    outputs: tuple[int, ...]
    tables: tuple[tuple[str, int], ...] = ()  # types and lengths

    @property
    def reads(self) -> dict[int, int]:
        """Operation number -> index of the input, for each operation `input`."""
        return {i: op.detail for i, op in enumerate(self.operations) if op.name == "input"}

    def needed(self, outputs: Iterable[int] | None = None) -> list[int]:
        """Return the operations on which `outputs` (default: all) depend, in order."""
        wanted = bytearray(len(self.operations))
        for i in self.outputs if outputs is None else outputs:
            wanted[i] = 1
        # Backwards, because operands come before the operations that read them.
        for i in range(len(self.operations) - 1, -1, -1):
            if wanted[i]:
                for operand in self.operations[i].operands:
                    wanted[operand] = 1
        return [i for i, w in enumerate(wanted) if w]

    def replay(self, apply: Callable[..., Any]) -> list[Any]:
        """Return the outputs. apply(operation, *results of its operands) computes one operation."""
        values = {}
        for i in self.needed():
            operation = self.operations[i]
            values[i] = apply(operation, *(values[o] for o in operation.operands))
        return [values[i] for i in self.outputs]


def to_bits(dtype: str, value: Any) -> int:
    """Return the bit pattern of a number."""
    stored = np.asarray(value, dtype)
    return int(stored.view(f"u{stored.dtype.itemsize}"))
