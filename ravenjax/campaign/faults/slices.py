"""Work on millions of rows: slices of them side by side in threads. NumPy gives the interpreter lock back meanwhile."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

T = TypeVar("T")

ROWS = 2**17
"""Of a slice: what is made of them on the way stays in a core's cache."""


def each(function: Callable[[slice], T], rows: int) -> list[T]:
    """`function` of slices that hold so many rows, in order; of one slice at least."""
    slices = [slice(first, first + ROWS) for first in range(0, max(rows, 1), ROWS)]
    threads = min(len(slices), len(os.sched_getaffinity(0)))
    if threads == 1:
        return [function(some) for some in slices]
    with ThreadPoolExecutor(threads) as pool:
        return list(pool.map(function, slices))
