"""Which rows are computed together: blocks for the engine, in windows whose golden runs fit in
memory; and how the columns of blocks become those of parts.
"""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

SHARED = 32
"""Lanes that must share a golden run, on average, for an engine to hold its series once rather
than once a lane.
"""


class Window(NamedTuple):
    """Rows that follow one another, in blocks."""

    rows: np.ndarray  # int64, in order
    blocks: list[np.ndarray]  # of each the places of its rows in `rows`
    golden_runs: np.ndarray  # numbers of their golden runs, ascending


class WindowLimits(NamedTuple):
    """What a window may have at most."""

    lanes: int  # of a block
    blocks: int
    golden_runs: int
    alone: int  # lanes of a block in which hardly any share one


def cut_into_windows(
    ranges: Iterable[range],
    golden: np.ndarray,
    limits: WindowLimits,
    acts: np.ndarray | None = None,
) -> Iterator[Window]:
    """The rows of `ranges` in order, in windows of blocks.

    golden: number of each row's golden run. acts: of each row, int. Within a window blocks are of
    rows that have the same golden run and then act at about the same time.
    """
    acts = np.zeros(len(golden), np.int32) if acts is None else acts
    some: list[np.ndarray] = []
    golden_runs = np.zeros(0, golden.dtype)
    count = 0
    for full in _blocks(ranges, limits.lanes):
        for block in _split_to_fit(full, golden, limits):
            together = np.union1d(golden_runs, golden[block])
            if some and (len(together) > limits.golden_runs or count == limits.blocks):
                yield _window(some, golden, acts, limits)
                some, together, count = [], np.unique(golden[block]), 0
            some.append(block)
            golden_runs, count = together, count + 1
    if some:
        yield _window(some, golden, acts, limits)


def _window(
    some: list[np.ndarray], golden: np.ndarray, acts: np.ndarray, limits: WindowLimits
) -> Window:
    rows = np.concatenate(some)
    order = np.lexsort((acts[rows], golden[rows]))
    sizes = range(0, len(rows), limits.lanes)
    pieces = (
        piece
        for i in sizes
        for piece in _split_to_fit(order[i : i + limits.lanes], golden[rows], limits)
    )
    return Window(rows, list(pieces), np.unique(golden[rows]))


def _blocks(ranges: Iterable[range], lanes: int) -> Iterator[np.ndarray]:
    pieces: list[range] = []
    room = lanes
    for rows in ranges:
        while rows:
            pieces.append(rows[:room])
            rows, room = rows[room:], room - len(pieces[-1])
            if not room:
                yield np.concatenate([np.arange(some.start, some.stop) for some in pieces])
                pieces, room = [], lanes
    if pieces:
        yield np.concatenate([np.arange(some.start, some.stop) for some in pieces])


def _split_to_fit(
    rows: np.ndarray, golden: np.ndarray, limits: WindowLimits
) -> Iterator[np.ndarray]:
    """`rows` as they are where their golden runs fit and are shared, else in pieces that bear
    one for each row.
    """
    golden_runs = len(np.unique(golden[rows]))
    shared = golden_runs <= max(1, len(rows) // SHARED)
    alone = min(limits.alone, limits.golden_runs)
    whole = golden_runs <= limits.golden_runs and (shared or len(rows) <= alone)
    step = len(rows) if whole else alone
    yield from (rows[i : i + step] for i in range(0, len(rows), step))


class WindowTable(Mapping[str, np.ndarray]):
    """Columns of a window's rows by name; each block's are put where its rows stand, by any
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


Tables = tuple[WindowTable, ...]
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


def assemble_parts(ranges: Iterable[range], blocks: Iterable[Tables]) -> Iterator[PartRows]:
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
