"""Estimates the rate of events in one new unit, drawn like the observed units.

A unit is a draw with several trials, such as an operator with several operations. The share of
events in its trials differs from its rate by chance. The beta-binomial model (Skellam, JRSS B 10,
1948) separates the two: rates of units are beta distributed, and trials are binomial. The prior of
the mean is uniform, and so is that of the square root of the intra-class correlation. Both are
integrated over a grid, so that an interval is wide if chance explains the differences.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import Rate

FEWEST = 5
"""Number of units below which there is no interval, because they do not show how units differ."""
GRID = 31
_NEGLIGIBLE = 12.0  # difference of log likelihood from its maximum


class UnitRate(NamedTuple):
    """Shares over all units, with the interval of one unit's rate."""

    rate: Rate
    units: int
    # Standard deviation of the units' rates, the posterior's mean; NaN if it cannot be estimated.
    deviation: float


def rate_per_unit(k: ArrayLike, n: ArrayLike) -> UnitRate:
    """Return the rate for k of n trials of each unit [units]. Units without trials are left out.

    The 95 % interval is NaN for fewer than FEWEST units, or if no unit has a second trial, because
    chance then explains any difference between units.
    """
    hits, trials = np.asarray(k, float), np.asarray(n, float)
    hits, trials = hits[trials > 0], trials[trials > 0]
    total, among, count = int(hits.sum()), int(trials.sum()), len(trials)
    value = total / among if among else np.nan
    if count < FEWEST or among <= count:
        return UnitRate(Rate(total, among, value), count, np.nan)
    mean, root, weight = _posterior(hits, trials)
    low, high = (_quantile(mean, root, weight, q) for q in (0.025, 0.975))
    deviation = np.nan
    # Else the prior alone would decide how units differ.
    if 0 < total < among:
        deviation = float((weight * root * np.sqrt(mean * (1.0 - mean))).sum())
    return UnitRate(Rate(total, among, value, low, high), count, deviation)


def _posterior(hits: np.ndarray, trials: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return mean, root of the intra-class correlation and weight on a grid, [GRID**2] each."""
    total, among = hits.sum(), trials.sum()
    middle = np.log((total + 0.5) / (among - total + 0.5))
    expected = trials * (total + 0.5) / (among + 1.0)
    excess = (
        (hits - expected) ** 2 / (expected * (1.0 - (total + 0.5) / (among + 1.0)))
    ).sum() / len(hits)
    error = np.sqrt((1.0 / (total + 0.5) + 1.0 / (among - total + 0.5)) * max(1.0, excess))
    means = 1.0 / (1.0 + np.exp(-(middle + 6.0 * error * np.linspace(-1.0, 1.0, GRID))))
    coarse = np.geomspace(1e-4, 0.95, GRID)
    best = _likelihood(hits, trials, means[:, None], coarse[None, :]).max(axis=0)
    likely = coarse[best > best.max() - _NEGLIGIBLE]
    least = 1e-4 if likely[0] == coarse[0] else likely[0] * coarse[0] / coarse[1]
    roots = np.linspace(least, min(0.95, likely[-1] * coarse[1] / coarse[0]), GRID)
    mean, root = (points.ravel() for points in np.meshgrid(means, roots, indexing="ij"))
    logarithm = _likelihood(hits, trials, mean, root) + np.log(
        mean * (1.0 - mean)
    )  # uniform prior in the mean
    weight = np.exp(logarithm - logarithm.max())
    return mean, root, weight / weight.sum()


def _likelihood(
    hits: np.ndarray, trials: np.ndarray, mean: np.ndarray, root: np.ndarray
) -> np.ndarray:
    from scipy.stats import betabinom

    first, second = (part[..., None] for part in _beta(*np.broadcast_arrays(mean, root)))
    return betabinom.logpmf(hits, trials, first, second).sum(axis=-1)


def _beta(mean: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    size = 1.0 / root**2 - 1.0
    return mean * size, (1.0 - mean) * size


def _quantile(mean: np.ndarray, root: np.ndarray, weight: np.ndarray, wanted: float) -> float:
    from scipy.optimize import brentq
    from scipy.special import betainc

    one, other = _beta(mean, root)
    found: Any = brentq(lambda x: weight @ betainc(one, other, x) - wanted, 0.0, 1.0, xtol=1e-9)
    return float(found)
