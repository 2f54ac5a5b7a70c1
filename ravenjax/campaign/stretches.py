"""Which rows are computed together: blocks for the engine, and stretches of blocks whose twins fit in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

SHARED = 32
"""Lanes that must share a twin, on average, for an engine to hold its time series once rather than once a lane."""


class Stretch(NamedTuple):
    """Some blocks that follow one another."""

    blocks: list[np.ndarray]  # of each the rows, int64, ascending
    twins: np.ndarray  # numbers of their twins, ascending


def cut(ranges: Iterable[range], twin: np.ndarray, lanes: int, most_twins: int, ahead: int) -> Iterator[Stretch]:
    """The rows of `ranges` in order, in blocks of at most `lanes` and stretches of at most `ahead` blocks.

    twin: number of each row's twin. No stretch has more than `most_twins` of them, and no block more lanes than that
    where hardly any of its lanes share one.
    """
    blocks: list[np.ndarray] = []
    twins = np.zeros(0, twin.dtype)
    for full in _blocks(ranges, lanes):
        for block in _fitting(full, twin, most_twins):
            together = np.union1d(twins, twin[block])
            if blocks and (len(together) > most_twins or len(blocks) == ahead):
                yield Stretch(blocks, twins)
                blocks, together = [], np.unique(twin[block])
            blocks.append(block)
            twins = together
    if blocks:
        yield Stretch(blocks, twins)


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


def _fitting(rows: np.ndarray, twin: np.ndarray, most_twins: int) -> Iterator[np.ndarray]:
    """`rows` as they are where their twins fit and are shared, else in pieces of which every row may have its own."""
    twins = len(np.unique(twin[rows]))
    shared = twins <= max(1, len(rows) // SHARED)
    whole = twins <= most_twins and (shared or len(rows) <= most_twins)
    step = len(rows) if whole else most_twins
    yield from (rows[i : i + step] for i in range(0, len(rows), step))
