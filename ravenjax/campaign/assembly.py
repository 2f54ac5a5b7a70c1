"""From blocks back to parts: columns of blocks of rows, cut and put together to the columns of each part."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np


class Ordered(Mapping[str, np.ndarray]):
    """Columns of several blocks by name, their rows in an order of their own, which need not be that of the blocks.

    A column is put in order when it is asked for, by the thread that asks: a campaign's parts are made side by side.
    """

    def __init__(self, blocks: Sequence[Mapping[str, np.ndarray]], order: np.ndarray) -> None:
        """order: of each row its place among the rows of all blocks, int64 [rows]."""
        self.order = order
        self._blocks, self._joined, self._lock = blocks, dict[str, np.ndarray](), threading.Lock()

    def __getitem__(self, name: str) -> np.ndarray:
        return self.some(name, slice(None))

    def __iter__(self) -> Iterator[str]:
        return iter(self._blocks[0])

    def __len__(self) -> int:
        return len(self._blocks[0])

    def some(self, name: str, rows: slice) -> np.ndarray:
        """These rows of a column."""
        with self._lock:
            if name not in self._joined:
                self._joined[name] = np.concatenate([block[name] for block in self._blocks])
        return self._joined[name][self.order[rows]]


Tables = tuple[Ordered, ...]
"""All of the same rows."""


class PartRows(NamedTuple):
    """The rows of one part, and the pieces of blocks that hold them."""

    rows: range
    pieces: list[tuple[Tables, slice]]

    def tables(self) -> tuple[dict[str, np.ndarray], ...]:
        """The columns of all its rows."""
        return tuple(
            {name: _joined([tables[t].some(name, where) for tables, where in self.pieces]) for name in table}
            for t, table in enumerate(self.pieces[0][0])
        )


def _joined(pieces: list[np.ndarray]) -> np.ndarray:
    return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)


def parts(ranges: Iterable[range], blocks: Iterable[Tables]) -> Iterator[PartRows]:
    """Each of `ranges` as soon as its rows are there; `blocks` hold the rows of all in order, none missing."""
    wanted = iter(ranges)
    part, room = PartRows(range(0), []), 0
    for block in blocks:
        size, first = len(block[0].order), 0
        while first < size:
            if not room:
                part = PartRows(next(wanted), [])
                room = len(part.rows)
            piece = slice(first, min(size, first + room))
            part.pieces.append((block, piece))
            first, room = piece.stop, room - (piece.stop - first)
            if not room:
                yield part
