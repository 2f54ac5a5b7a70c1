"""Records of single numbers as rows of memory: what `transition`s are made for."""

from __future__ import annotations

from typing import Any

import numpy as np

from ravenjax.engines.cpu import transition
from ravenjax.engines.cpu.memory import RowLayout
from ravenjax.numbers.lazy import jax


class RecordKind:
    """The shape of a record of NumPy numbers: its tree, its number types and where they stand in
    memory.
    """

    def __init__(self, example: Any) -> None:
        leaves: list[Any]
        leaves, tree = jax.tree.flatten(example)
        self.tree: Any = tree
        self.types = tuple(str(np.dtype(leaf.dtype)) for leaf in leaves)
        self.layout = RowLayout.packed(self.types)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, RecordKind) and (self.tree, self.types) == (
            other.tree,
            other.types,
        )

    def __hash__(self) -> int:
        return hash((self.tree, self.types))

    def abstract(self) -> Any:
        """The record as tracing takes it."""
        return jax.tree.unflatten(
            self.tree, [jax.ShapeDtypeStruct((), dtype) for dtype in self.types]
        )

    def row(self, value: Any) -> np.ndarray:
        """A record's numbers in memory."""
        row = transition.rows(self.layout, 1)[0]
        transition.write(self.layout, row, jax.tree.leaves(value))
        return row

    def read(self, row: np.ndarray | bytes) -> Any:
        """The record of numbers in memory."""
        return jax.tree.unflatten(self.tree, transition.read(self.layout, row))
