"""Bootstraps any statistic that is computed from chosen units, such as runs."""

import warnings
from collections.abc import Callable

import numpy as np

from ravenjax.stats.intervals import Estimate, alpha_of


def bootstrap(
    units: int,
    statistic: Callable[[np.ndarray], np.ndarray],
    confidence: float = 0.95,
    *,
    resamples: int = 1000,
    seed: int = 0,
    batch: int = 100,
) -> Estimate:
    """Return the percentile band of a statistic of `units` exchangeable units.

    `statistic`: maps indices of the chosen units [b, m] to values [b, ...], one per row. At most
    `batch` rows are passed at a time, which bounds memory and does not change the result. Fewer
    than about 20 units give too narrow a band. The same seed gives the same band. Resamples without
    a value (NaN) are left out. Raises ValueError for fewer than 2 units.
    """
    if units < 2:
        raise ValueError(f"a bootstrap needs at least 2 independent units, got {units}")
    rng = np.random.default_rng(seed)
    sizes = [min(batch, resamples - first) for first in range(0, resamples, batch)]
    with np.errstate(invalid="ignore", divide="ignore"):
        value = np.asarray(statistic(np.arange(units)[None]), float)[0]
        samples = np.concatenate(
            [np.asarray(statistic(rng.integers(units, size=(n, units))), float) for n in sizes]
        )
    low, high = band_ends(samples, confidence)
    return Estimate(value, low, high)


def band_ends(samples: np.ndarray, confidence: float = 0.95) -> np.ndarray:
    """Return both ends [2, ...] of the central share of samples [b, ...]; NaN if all samples are
    NaN.
    """
    alpha = alpha_of(confidence)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanquantile(samples, [alpha / 2, 1 - alpha / 2], axis=0)
