"""Step curves as they are drawn: a page, a printed figure and a study draw the points that are
made here.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

RESOLUTION = 1 / 400
"""Of the curve's height: values that differ by less may be drawn as one, so no larger step is
lost.
"""


class Steps(NamedTuple):
    """A curve that holds each value until the next x, and its band; arrays [points], x never
    falls.
    """

    x: np.ndarray
    y: np.ndarray
    low: np.ndarray  # of a curve without a band: y
    high: np.ndarray


def steps(
    x: ArrayLike,
    y: ArrayLike,
    low: ArrayLike | None = None,
    high: ArrayLike | None = None,
    *,
    start: float | None = None,
    end: float | None = None,
) -> Steps:
    """The points of a curve [n] that are drawn: the first, the last, and each at which a value of
    curve or band leaves the interval of RESOLUTION in which the point before lies.

    start: x below it are drawn there (a logarithmic axis has no zero), the last of them holds. end:
    the last value is held until there, or to the last x. ValueError where lengths differ, x falls,
    or there is no point.
    """
    across = np.asarray(x, float)
    values = np.array([np.asarray(y if part is None else part, float) for part in (y, low, high)])
    if across.ndim != 1 or not len(across) or values.shape != (3, len(across)):
        raise ValueError(
            f"steps: x {across.shape} and values {values.shape[1:]} must be of one length, at"
            " least 1"
        )
    if (np.diff(across) < 0).any():
        raise ValueError("steps: x must not fall")
    if start is not None:
        first = max(0, int(np.searchsorted(across, start, side="right")) - 1)
        across, values = np.maximum(across[first:], start), values[:, first:]
    height = float(np.abs(values[0]).max() or np.abs(values).max()) or 1.0
    interval = np.floor(values / (RESOLUTION * height))
    corner = np.concatenate([[True], (np.diff(interval, axis=1) != 0).any(axis=0)])
    corner[-1] = True
    across, values = across[corner], values[:, corner]
    if end is not None and end > across[-1]:
        across, values = np.append(across, end), np.hstack([values, values[:, -1:]])
    return Steps(across, *values)


def corners(x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The corners of a step curve in their order: along, then up or down."""
    return np.repeat(x, 2)[1:], np.repeat(y, 2)[:-1]
