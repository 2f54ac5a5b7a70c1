"""Divides a campaign's runs into windows that fit in memory, and each window into blocks of runs.

An engine computes a block at once. The module also joins results of blocks to files of the result.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
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
    unshared_lanes: int  # largest number of lanes of a block whose runs have different golden runs


def cut_into_windows(
    ranges: Sequence[range], golden: np.ndarray, acts: np.ndarray, limits: WindowLimits
) -> Iterator[Window]:
    """Yield the rows of `ranges` in order, in windows of blocks. golden: number of each row's
    golden run. acts: first tick in which each row's faults may act. In a window, rows are sorted by
    both. If a block has fewer than SHARED rows per golden run, an engine copies the time series of
    a golden run for each lane. Such a block is divided, to limit its memory.
    """
    rows = np.concatenate([np.arange(span.start, span.stop) for span in ranges])
    lanes = limits.lanes
    # Each lane of an unshared block may have another golden run, so both limits apply.
    unshared_lanes = min(limits.unshared_lanes, limits.golden_runs)
    begin = 0
    while begin < len(rows):
        window_rows = rows[begin : begin + lanes * limits.blocks]
        # For each golden run, the index of its first row, ascending.
        first_rows = np.sort(np.unique(golden[window_rows], return_index=True)[1])
        # The window ends before the first row of a golden run that is too many.
        if len(first_rows) > limits.golden_runs:
            window_rows = window_rows[: first_rows[limits.golden_runs]]
        begin += len(window_rows)
        order = np.lexsort((acts[window_rows], golden[window_rows]))
        blocks = []
        for start in range(0, len(order), lanes):
            block = order[start : start + lanes]
            golden_count = len(np.unique(golden[window_rows[block]]))
            is_shared = golden_count <= max(1, len(block) // SHARED)
            size = len(block) if is_shared else unshared_lanes
            blocks += [block[i : i + size] for i in range(0, len(block), size)]
        yield Window(window_rows, blocks)


Columns = dict[str, np.ndarray]


def take_rows(columns: Mapping[str, np.ndarray], rows: Any) -> Columns:
    """Return these rows of each column. rows: indices, a mask or a slice."""
    return {name: values[rows] for name, values in columns.items()}


OutcomePair = tuple[Columns, Columns]
"""Outcomes of some rows, and outcomes of the golden run of each row."""


def concatenate(tables: Sequence[Columns], join: Callable[..., Any] = np.concatenate) -> Columns:
    """Join the rows of several tables with the same columns. join: joins the parts of a column."""
    return {name: join([table[name] for table in tables]) for name in tables[0]}


def join_blocks(window: Window, blocks: Sequence[OutcomePair]) -> OutcomePair:
    """Join the outcomes of a window's blocks. Return them in the order of the window's rows. A
    column with one value for all rows stays one number (stride 0), to save memory.
    """
    order = np.argsort(np.concatenate(window.blocks))

    def join_column(columns: Sequence[np.ndarray]) -> np.ndarray:
        are_constant = all(column.strides == (0,) for column in columns)
        if are_constant and len({column[:1].tobytes() for column in columns}) == 1:
            return np.broadcast_to(columns[0][:1], len(order))
        return np.concatenate(columns)[order]

    outcomes, golden_outcomes = zip(*blocks, strict=True)
    return concatenate(outcomes, join_column), concatenate(golden_outcomes, join_column)


class PartRows(NamedTuple):
    """The rows of one file of the result table, with their outcomes."""

    rows: range
    outcomes: Columns
    golden_runs: Columns


def assemble_parts(ranges: Iterable[range], windows: Iterable[OutcomePair]) -> Iterator[PartRows]:
    """Yield the outcomes of each of `ranges` as soon as its rows are computed. windows: outcomes of
    the rows of all ranges, in order. A window may end within a range.
    """
    remaining_windows = iter(windows)
    outcomes: Columns = {}
    golden_outcomes: Columns = {}
    # Next row of the window, and number of its rows.
    start = size = 0
    for rows in ranges:
        pieces: list[OutcomePair] = []
        missing = len(rows)
        while missing:
            if start == size:
                outcomes, golden_outcomes = next(remaining_windows)
                start, size = 0, len(next(iter(outcomes.values())))
            taken = slice(start, min(size, start + missing))
            pieces.append((take_rows(outcomes, taken), take_rows(golden_outcomes, taken)))
            missing -= taken.stop - start
            start = taken.stop
        # Most ranges lie in one window, and then nothing is copied.
        whole = pieces[0] if len(pieces) == 1 else map(concatenate, zip(*pieces, strict=True))
        yield PartRows(rows, *whole)
    # This runs the code of the generator after its last window.
    next(remaining_windows, None)
