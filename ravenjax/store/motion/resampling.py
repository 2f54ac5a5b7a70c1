"""Samples at any times to one a millisecond: by time, through every sample, and a low-pass where
one is wanted.

Between two samples a piecewise cubic (PCHIP) rises or falls as they do: it has no corners and never
leaves what was recorded. Of a curve whose second derivative is at most M it is at most M h**2 / 2
off where samples are h apart.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

TICK_S = 1e-3
"""As TICK_S of raven2.console.motion, which cannot be imported without importing jax; reports do
without it.
"""


def by_time(time_s: np.ndarray, values: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """`values` [T] or [T, k] at times `at_s` within those of the samples."""
    from scipy.interpolate import PchipInterpolator  # slow to import

    return PchipInterpolator(time_s, values, axis=0)(np.clip(at_s, time_s[0], time_s[-1]))


def turns_by_time(time_s: np.ndarray, quat: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """Unit quaternions [T, 4] at times `at_s`; neighbours of opposite sign are the same
    rotation.
    """
    signs = np.cumprod(np.where(np.sum(quat[1:] * quat[:-1], axis=1) < 0.0, -1.0, 1.0))
    return unit(by_time(time_s, quat * np.concatenate([[1.0], signs])[:, None], at_s))


def unit(quat: np.ndarray) -> np.ndarray:
    """Quaternions at length 1."""
    return quat / np.linalg.norm(quat, axis=1, keepdims=True)


def before(time_s: np.ndarray, values: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """`values` [T] of the last sample at or before each time: what switches keeps its state
    until it is said anew.
    """
    return values[
        np.clip(np.searchsorted(time_s, at_s + 1e-9, side="right") - 1, 0, len(values) - 1)
    ]


def at_rows(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """`values` [T] or [T, k] at fractional rows, linearly: rows are a millisecond apart."""
    low = np.clip(np.floor(rows).astype(int), 0, len(values) - 2)
    part = (rows - low).reshape(-1, *[1] * (values.ndim - 1))
    return values[low] * (1.0 - part) + values[low + 1] * part


def low_pass(values: np.ndarray, cutoff_hz: float, stretches: list[tuple[int, int]]) -> np.ndarray:
    """Each stretch (first row, row after the last) of `values` [T, k] without what is faster,
    and without phase.
    """
    from scipy.signal import butter, sosfiltfilt  # slow to import

    sections = butter(2, cutoff_hz, fs=1.0 / TICK_S, output="sos")
    smooth = values.copy()
    for begin, end in stretches:
        padding = min(end - begin - 1, round(3.0 / (cutoff_hz * TICK_S)))
        smooth[begin:end] = sosfiltfilt(sections, values[begin:end], axis=0, padlen=padding)
    return smooth


def stretches(mask: np.ndarray, cuts: Sequence[int] = ()) -> list[tuple[int, int]]:
    """(first, after the last) of each run of true values; a new one begins at each of `cuts`,
    ascending.
    """
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    pieces = []
    for begin, end in edges.reshape(-1, 2).tolist():
        bounds = [begin, *dict.fromkeys(cut for cut in cuts if begin < cut < end), end]
        pieces += itertools.pairwise(bounds)
    return pieces


def seconds(spans: list[tuple[int, int]]) -> list[tuple[float, float]]:
    """Spans of rows as times."""
    return [(begin * TICK_S, end * TICK_S) for begin, end in spans]
