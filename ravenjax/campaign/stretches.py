"""Which rows are computed together: blocks for the engine, and stretches of blocks whose golden
runs fit in memory.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

SHARED = 32
"""Lanes that must share a golden run, on average, for an engine to hold its series once rather
than once a lane.
"""


class Stretch(NamedTuple):
    """Rows that follow one another, in blocks."""

    rows: np.ndarray  # int64, in order
    blocks: list[np.ndarray]  # of each the places of its rows in `rows`
    golden_runs: np.ndarray  # numbers of their golden runs, ascending


class StretchLimits(NamedTuple):
    """What a stretch may have at most."""

    lanes: int  # of a block
    blocks: int
    golden_runs: int
    alone: int  # lanes of a block in which hardly any share one


def cut(
    ranges: Iterable[range],
    golden: np.ndarray,
    limits: StretchLimits,
    acts: np.ndarray | None = None,
) -> Iterator[Stretch]:
    """The rows of `ranges` in order, in stretches of blocks.

    golden: number of each row's golden run. acts: of each row, int. Within a stretch blocks are of
    rows that have the same golden run and then act at about the same time.
    """
    acts = np.zeros(len(golden), np.int32) if acts is None else acts
    some: list[np.ndarray] = []
    golden_runs = np.zeros(0, golden.dtype)
    count = 0
    for full in _blocks(ranges, limits.lanes):
        for block in _fitting(full, golden, limits):
            together = np.union1d(golden_runs, golden[block])
            if some and (len(together) > limits.golden_runs or count == limits.blocks):
                yield _stretch(some, golden, acts, limits)
                some, together, count = [], np.unique(golden[block]), 0
            some.append(block)
            golden_runs, count = together, count + 1
    if some:
        yield _stretch(some, golden, acts, limits)


def _stretch(
    some: list[np.ndarray], golden: np.ndarray, acts: np.ndarray, limits: StretchLimits
) -> Stretch:
    rows = np.concatenate(some)
    order = np.lexsort((acts[rows], golden[rows]))
    sizes = range(0, len(rows), limits.lanes)
    pieces = (
        piece
        for i in sizes
        for piece in _fitting(order[i : i + limits.lanes], golden[rows], limits)
    )
    return Stretch(rows, list(pieces), np.unique(golden[rows]))


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


def _fitting(rows: np.ndarray, golden: np.ndarray, limits: StretchLimits) -> Iterator[np.ndarray]:
    """`rows` as they are where their golden runs fit and are shared, else in pieces that bear
    one for each row.
    """
    golden_runs = len(np.unique(golden[rows]))
    shared = golden_runs <= max(1, len(rows) // SHARED)
    alone = min(limits.alone, limits.golden_runs)
    whole = golden_runs <= limits.golden_runs and (shared or len(rows) <= alone)
    step = len(rows) if whole else alone
    yield from (rows[i : i + step] for i in range(0, len(rows), step))
