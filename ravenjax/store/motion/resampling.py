"""Resamples to one sample per millisecond, with an optional low-pass filter.

The interpolating curve contains every sample. Between two samples the piecewise cubic (PCHIP) is
monotonic: it has no corners and stays within the recorded values. For a curve with a second
derivative of at most M, the error is at most M h**2 / 2, where h is the distance of samples.
"""

import itertools
from collections.abc import Sequence

import numpy as np

from ravenjax.store.logs.topics import continuous_turns
from ravenjax.vocabulary import TICK_S


def by_time(time_s: np.ndarray, values: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """Interpolate `values` [T] or [T, k] at times `at_s`, all within the samples' times."""
    from scipy.interpolate import PchipInterpolator

    return PchipInterpolator(time_s, values, axis=0)(np.clip(at_s, time_s[0], time_s[-1]))


def turns_by_time(time_s: np.ndarray, quat: np.ndarray, at_s: np.ndarray) -> np.ndarray:
    """Interpolate orientations, unit quaternions [T, 4], at times `at_s`."""
    turns = by_time(time_s, continuous_turns(quat), at_s)
    return turns / np.linalg.norm(turns, axis=1, keepdims=True)


def at_rows(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Interpolate `values` [T] or [T, k] linearly at the fractional row numbers `rows`."""
    low = np.clip(np.floor(rows).astype(int), 0, len(values) - 2)
    # The weight of the upper row, with further axes of length 1 to multiply `values`.
    weight = (rows - low).reshape(-1, *[1] * (values.ndim - 1))
    return values[low] * (1.0 - weight) + values[low + 1] * weight


def low_pass(values: np.ndarray, cutoff_hz: float, stretches: list[tuple[int, int]]) -> np.ndarray:
    """Apply a low-pass filter without phase shift to each stretch (begin, end) of `values` [T, k].
    Rows are 1 ms apart. Different stretches do not influence each other.
    """
    from scipy.signal import butter, sosfiltfilt

    sections = butter(2, cutoff_hz, fs=1.0 / TICK_S, output="sos")
    smooth = values.copy()
    for begin, end in stretches:
        # Three periods of the cutoff frequency, or as much as the stretch permits.
        padding = min(end - begin - 1, round(3.0 / (cutoff_hz * TICK_S)))
        smooth[begin:end] = sosfiltfilt(sections, values[begin:end], axis=0, padlen=padding)
    return smooth


def true_stretches(mask: np.ndarray, cuts: Sequence[int] = ()) -> list[tuple[int, int]]:
    """Return (first row, row after the last) of each stretch of true values in `mask`. A new
    stretch begins at each row in `cuts`, which must be ascending.
    """
    # Rows at which the mask changes: begin, end, begin, end, ...
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(int)))
    pieces = []
    for begin, end in edges.reshape(-1, 2).tolist():
        bounds = [begin, *dict.fromkeys(cut for cut in cuts if begin < cut < end), end]
        pieces += itertools.pairwise(bounds)
    return pieces


def stretches_in_seconds(
    mask: np.ndarray, cuts: Sequence[int] = (), shortest: int = 1
) -> list[tuple[float, float]]:
    """Return (begin, end) in s of stretches of at least `shortest` true rows, the longest first."""
    spans = sorted(true_stretches(mask, cuts), key=lambda span: span[0] - span[1])
    return [(begin * TICK_S, end * TICK_S) for begin, end in spans if end - begin >= shortest]
