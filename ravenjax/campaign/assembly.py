"""From blocks back to parts: columns of blocks of rows, cut and put together to the columns of
each part.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np


class StretchTable(Mapping[str, np.ndarray]):
    """Columns of a stretch's rows by name; each block's are put where its rows stand, by any
    thread.

    A column of one value, as of the golden run that all rows share, comes and stays as one number
    (stride 0).
    """

    def __init__(self, rows: int) -> None:
        self.rows = rows
        self._columns: dict[str, np.ndarray] = {}
        self._lock = threading.Lock()

    def __getitem__(self, name: str) -> np.ndarray:
        return self._columns[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._columns)

    def __len__(self) -> int:
        return len(self._columns)

    def put(self, places: np.ndarray, block: Mapping[str, np.ndarray]) -> None:
        """The rows of a block; places: of each where it stands, int64 [rows of the block]."""
        with self._lock:
            for name, values in block.items():
                self._columns[name] = self._room(self._columns.get(name), values)
        for name, values in block.items():
            if not _constant(self._columns[name]):
                self._columns[name][places] = values

    def _room(self, there: np.ndarray | None, values: np.ndarray) -> np.ndarray:
        """The whole column, with room for these values of it."""
        if there is None:
            alike = _constant(values)
            return (
                np.broadcast_to(values[:1], self.rows)
                if alike
                else np.empty(self.rows, values.dtype)
            )
        if _constant(there) and not (
            _constant(values) and values[:1].tobytes() == there[:1].tobytes()
        ):
            return there.copy()
        return there


def _constant(column: np.ndarray) -> bool:
    return column.strides == (0,)


Tables = tuple[StretchTable, ...]
"""All of the same rows."""


class PartRows(NamedTuple):
    """The rows of one part, and the pieces of blocks that hold them."""

    rows: range
    pieces: list[tuple[Tables, slice]]

    def tables(self) -> tuple[dict[str, np.ndarray], ...]:
        """The columns of all its rows."""
        return tuple(
            {
                name: _joined([tables[t][name][where] for tables, where in self.pieces])
                for name in table
            }
            for t, table in enumerate(self.pieces[0][0])
        )


def _joined(pieces: list[np.ndarray]) -> np.ndarray:
    return pieces[0] if len(pieces) == 1 else np.concatenate(pieces)


def parts(ranges: Iterable[range], blocks: Iterable[Tables]) -> Iterator[PartRows]:
    """Each of `ranges` as soon as its rows are there; `blocks` hold the rows of all in order,
    none missing.
    """
    wanted = iter(ranges)
    part, room = PartRows(range(0), []), 0
    for block in blocks:
        size, first = block[0].rows, 0
        while first < size:
            if not room:
                part = PartRows(next(wanted), [])
                room = len(part.rows)
            piece = slice(first, min(size, first + room))
            part.pieces.append((block, piece))
            first, room = piece.stop, room - (piece.stop - first)
            if not room:
                yield part
