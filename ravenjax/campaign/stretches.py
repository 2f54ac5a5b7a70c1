"""Which rows are computed together: blocks for the engine, and stretches of blocks whose golden runs fit in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import numpy as np

SHARED = 32
"""Lanes that must share a golden run, on average, for an engine to hold its series once rather than once a lane."""


class Stretch(NamedTuple):
    """Some blocks that follow one another."""

    blocks: list[np.ndarray]  # of each the rows, int64, ascending
    golden_runs: np.ndarray  # numbers of their golden runs, ascending


def cut(
    ranges: Iterable[range], golden: np.ndarray, lanes: int, most_golden_runs: int, ahead: int
) -> Iterator[Stretch]:
    """The rows of `ranges` in order, in blocks of at most `lanes` and stretches of at most `ahead` blocks.

    golden: number of each row's golden run. No stretch has more than `most_golden_runs` of them, and no block more
    lanes than that
    where hardly any of its lanes share one.
    """
    blocks: list[np.ndarray] = []
    golden_runs = np.zeros(0, golden.dtype)
    for full in _blocks(ranges, lanes):
        for block in _fitting(full, golden, most_golden_runs):
            together = np.union1d(golden_runs, golden[block])
            if blocks and (len(together) > most_golden_runs or len(blocks) == ahead):
                yield Stretch(blocks, golden_runs)
                blocks, together = [], np.unique(golden[block])
            blocks.append(block)
            golden_runs = together
    if blocks:
        yield Stretch(blocks, golden_runs)


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


def _fitting(rows: np.ndarray, golden: np.ndarray, most_golden_runs: int) -> Iterator[np.ndarray]:
    """`rows` as they are where their golden runs fit and are shared, else in pieces that bear one for each row."""
    golden_runs = len(np.unique(golden[rows]))
    shared = golden_runs <= max(1, len(rows) // SHARED)
    whole = golden_runs <= most_golden_runs and (shared or len(rows) <= most_golden_runs)
    step = len(rows) if whole else most_golden_runs
    yield from (rows[i : i + step] for i in range(0, len(rows), step))
