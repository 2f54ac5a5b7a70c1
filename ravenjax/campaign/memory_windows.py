"""Which rows are computed together: blocks for the engine, in windows whose golden runs fit in
memory; and how the columns of blocks become those of parts.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
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


Columns = dict[str, np.ndarray]
Pair = tuple[Columns, Columns]
"""Outcomes of some rows, and those of their golden runs."""


def join_blocks(window: Window, blocks: Sequence[Pair]) -> Pair:
    """The columns of a window's blocks in the order of its rows.

    A column of one value, as of a golden run that all rows share, stays one number (stride 0).
    """
    order = np.argsort(np.concatenate(window.blocks))

    def join(columns: Sequence[np.ndarray]) -> np.ndarray:
        alike = all(column.strides == (0,) for column in columns)
        if alike and len({column[:1].tobytes() for column in columns}) == 1:
            return np.broadcast_to(columns[0][:1], len(order))
        return np.concatenate(columns)[order]

    rows, golden_runs = (
        {name: join([table[name] for table in tables]) for name in tables[0]}
        for tables in zip(*blocks, strict=True)
    )
    return rows, golden_runs


class PartRows(NamedTuple):
    """The rows of one part."""

    rows: range
    outcomes: Columns
    golden_runs: Columns


def assemble_parts(ranges: Iterable[range], windows: Iterable[Pair]) -> Iterator[PartRows]:
    """Each of `ranges` as soon as its rows are there; `windows` hold the rows of all in order."""
    coming = iter(windows)
    pair: Pair = {}, {}
    first = size = 0
    for rows in ranges:
        pieces: list[Pair] = []
        lacking = len(rows)
        while lacking:
            if first == size:
                pair, first = next(coming), 0
                size = len(next(iter(pair[0].values())))
            end = min(size, first + lacking)
            outcomes, golden_runs = (
                {name: values[first:end] for name, values in columns.items()} for columns in pair
            )
            pieces.append((outcomes, golden_runs))
            first, lacking = end, lacking - (end - first)
        outcomes, golden_runs = pieces[0]
        if len(pieces) > 1:
            outcomes, golden_runs = (
                {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}
                for tables in zip(*pieces, strict=True)
            )
        yield PartRows(rows, outcomes, golden_runs)
    # what computes the windows has something to say after the last one
    next(coming, None)
