"""Bands: what is normal may differ between signals, and between stretches of an operation.

Each signal is measured in a scale of its own in each segment, learned on some units; the largest of
all over an operation is one score, whose threshold is calibrated on other units (`threshold`). So
the band is the scale times the threshold, piecewise, and its promise is about leaving it anywhere
(functional bands: Diquigiovanni, Fontana, Vantini, J. Multivariate Analysis 189, 2022, with the
maximum of the modulated distance).
"""

from __future__ import annotations

import numpy as np

SHARE = 0.95
"""Quantile of an operation's maxima that is the scale of a signal in a segment."""
LEAST = 1e-6
"""Scale of a signal that is always less, times its largest scale in any segment."""


def scales(peaks: np.ndarray) -> np.ndarray:
    """Scale of each signal in each segment from maxima [operations, signals, segments]; float32
    [signals, segments].

    A signal that is 0 in all segments has scale 1 there. ValueError without operations, or where
    one is not finite.
    """
    if not len(peaks) or not np.isfinite(peaks).all():
        raise ValueError("scales are learned on finite maxima of at least one operation")
    level = np.quantile(peaks, SHARE, axis=0)
    largest = level.max(axis=-1, keepdims=True)
    level = np.maximum(level, LEAST * largest)
    return np.where(level > 0, level, 1.0).astype(np.float32)


def joint(peaks: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """The score of each operation: the largest of its maxima [operations, signals, segments] in
    their scales.

    In float32, as a monitor computes it: division by a positive number keeps the order, so this is
    the largest over time of what the monitor has in each millisecond, to the bit.
    """
    shares = peaks.astype(np.float32) / scale.astype(np.float32)
    return shares.reshape(len(peaks), -1).max(axis=1)
