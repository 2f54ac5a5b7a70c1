"""Divides a campaign into windows that fit in memory, and windows into blocks for an engine.

The module also joins the results of blocks to the files of the result folder.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

SHARED = 32
"""Smallest mean number of lanes per golden run with which an engine stores a golden run's series
once. With fewer lanes it stores a copy for each lane.
"""


class Window(NamedTuple):
    """Consecutive rows, divided into blocks."""

    rows: np.ndarray  # int64, ascending
    blocks: list[np.ndarray]  # for each block, the indices of its rows in `rows`


class WindowLimits(NamedTuple):
    """Largest sizes of a window."""

    lanes: int  # largest number of lanes of a block
    blocks: int
    golden_runs: int
    alone: int  # largest number of lanes of a block whose runs have different golden runs


def cut_into_windows(
    ranges: Sequence[range], golden: np.ndarray, acts: np.ndarray, limits: WindowLimits
) -> Iterator[Window]:
    """Yield the rows of `ranges` in order, in windows of blocks.

    golden: number of each row's golden run. acts: first tick in which each row's faults may act.
    The rows of a block share one golden run or a few, and act at about the same time.
    """
    rows = np.concatenate([np.arange(some.start, some.stop) for some in ranges])
    lanes, alone = limits.lanes, min(limits.alone, limits.golden_runs)
    begin = 0
    while begin < len(rows):
        some = rows[begin : begin + lanes * limits.blocks]
        # Index of the first row of each golden run.
        places = np.sort(np.unique(golden[some], return_index=True)[1])
        if len(places) > limits.golden_runs:
            some = some[: places[limits.golden_runs]]
        begin += len(some)
        order = np.lexsort((acts[some], golden[some]))
        blocks = []
        for full in (order[i : i + lanes] for i in range(0, len(order), lanes)):
            shared = len(np.unique(golden[some[full]])) <= max(1, len(full) // SHARED)
            step = len(full) if shared else alone
            blocks += [full[i : i + step] for i in range(0, len(full), step)]
        yield Window(some, blocks)


Columns = dict[str, np.ndarray]


def take_rows(columns: Mapping[str, np.ndarray], rows: Any) -> Columns:
    """Return these rows of each column. rows: indices, a mask or a slice."""
    return {name: values[rows] for name, values in columns.items()}


Pair = tuple[Columns, Columns]
"""Outcomes of some rows, and outcomes of the golden run of each row."""


def concatenate(tables: Sequence[Columns]) -> Columns:
    """Join the rows of several tables with the same columns."""
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def join_blocks(window: Window, blocks: Sequence[Pair]) -> Pair:
    """Return the columns of a window's blocks in the order of its rows.

    A column with one value for all rows stays one number (stride 0), to save memory.
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
    """The rows of one file of the result table, with their outcomes."""

    rows: range
    outcomes: Columns
    golden_runs: Columns


def assemble_parts(ranges: Iterable[range], windows: Iterable[Pair]) -> Iterator[PartRows]:
    """Yield each of `ranges` as soon as its rows are computed.

    windows: the rows of all ranges in order.
    """
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
            outcomes, golden_runs = (take_rows(columns, slice(first, end)) for columns in pair)
            pieces.append((outcomes, golden_runs))
            first, lacking = end, lacking - (end - first)
        whole = pieces[0] if len(pieces) == 1 else map(concatenate, zip(*pieces, strict=True))
        yield PartRows(rows, *whole)
    # This runs the code of the generator after its last window.
    next(coming, None)
