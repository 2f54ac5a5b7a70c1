"""Work on millions of rows: slices of them side by side in threads. NumPy gives the interpreter
lock back meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Mapping
from typing import TypeVar

import numpy as np

from ravenjax import threads

T = TypeVar("T")
Name = TypeVar("Name", bound=Hashable)

ROWS = 2**17
"""Of a slice: what is made of them on the way stays in a core's cache."""


def each(function: Callable[[slice], T], rows: int) -> list[T]:
    """`function` of slices that hold so many rows, in order; of one slice at least."""
    return threads.mapped(
        function, [slice(first, first + ROWS) for first in range(0, max(rows, 1), ROWS)]
    )


def joined(
    function: Callable[[slice], Mapping[Name, np.ndarray]], rows: int
) -> dict[Name, np.ndarray]:
    """The columns that `function` makes of slices, put together: [rows, ...], or [] of what all
    rows agree on.
    """
    first = slice(0, ROWS)
    begin = function(first)
    whole = {
        name: np.empty((rows, *values.shape[1:]), values.dtype) if values.ndim else values
        for name, values in begin.items()
    }

    def put(some: slice) -> None:
        for name, values in (begin if some == first else function(some)).items():
            if values.ndim:
                whole[name][some] = values

    each(put, rows)
    return whole
