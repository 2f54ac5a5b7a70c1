"""The best trade-offs of two costs."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike


def front(first: ArrayLike, second: ArrayLike) -> np.ndarray:
    """Which of n choices no other beats: bool [n], True where none is as low in both costs and
    lower in one.

    Two costs [n], less is better, each in any unit; equal choices stand or fall together. A choice
    with a NaN cost is never on the front and beats none. One sort, one running minimum.
    """
    x, y = np.asarray(first, float), np.asarray(second, float)
    best = np.zeros(len(x), bool)
    valid = np.flatnonzero(~np.isnan(x) & ~np.isnan(y))
    order = valid[np.lexsort((y[valid], x[valid]))]
    x, y = x[order], y[order]
    start = np.searchsorted(
        x, x
    )  # where the choices of the same first cost begin; the first of them has the least y
    before = np.concatenate([[np.inf], np.minimum.accumulate(y)])[start]
    unbounded = start == 0  # an infinite second cost still stands where nothing is cheaper
    best[order] = (y == y[start]) & ((y < before) | unbounded)
    return best
