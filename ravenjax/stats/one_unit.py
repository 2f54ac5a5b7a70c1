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
"""Smallest number of units for an interval; fewer do not show how much units differ."""
GRID = 31
_NEGLIGIBLE = 12.0  # log likelihoods that are lower than the maximum by this are neglected


class UnitRate(NamedTuple):
    """The share of events over all units, with the interval of a new unit's rate."""

    rate: Rate
    units: int
    # Posterior mean of the standard deviation of units' rates; NaN if it cannot be estimated.
    deviation: float


def rate_per_unit(k: ArrayLike, n: ArrayLike) -> UnitRate:
    """Return the rate of events from k events in n trials of each unit [units].

    Units without trials are left out. The 95 % interval is NaN for fewer than FEWEST units. It is
    NaN, too, if each unit has one trial, because chance then explains any difference.
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
    # Without events, or with only events, the deviation would depend only on the prior.
    if 0 < total < among:
        deviation = float((weight * root * np.sqrt(mean * (1.0 - mean))).sum())
    return UnitRate(Rate(total, among, value, low, high), count, deviation)


def _posterior(hits: np.ndarray, trials: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the posterior on a grid: mean, square root of the intra-class correlation, and weight,
    [GRID**2] each.
    """
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
    # The grid is uniform in the logit of the mean. The second term makes the prior uniform in the
    # mean.
    logarithm = _likelihood(hits, trials, mean, root) + np.log(mean * (1.0 - mean))
    weight = np.exp(logarithm - logarithm.max())
    return mean, root, weight / weight.sum()


def _likelihood(
    hits: np.ndarray, trials: np.ndarray, mean: np.ndarray, root: np.ndarray
) -> np.ndarray:
    # Returns the log-likelihood of beta-binomial counts for each pair of mean and `root`.
    from scipy.stats import betabinom

    first, second = (part[..., None] for part in _beta(*np.broadcast_arrays(mean, root)))
    return betabinom.logpmf(hits, trials, first, second).sum(axis=-1)


def _beta(mean: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    size = 1.0 / root**2 - 1.0
    return mean * size, (1.0 - mean) * size


def _quantile(mean: np.ndarray, root: np.ndarray, weight: np.ndarray, wanted: float) -> float:
    # Returns the `wanted` quantile of a mixture of beta distributions with these weights.
    from scipy.optimize import brentq
    from scipy.special import betainc

    one, other = _beta(mean, root)
    found: Any = brentq(lambda x: weight @ betainc(one, other, x) - wanted, 0.0, 1.0, xtol=1e-9)
    return float(found)
