"""Estimates the rate of events in one new unit, drawn like the observed units.

A unit is a draw with several trials, such as an operator with several operations. The share of
events in its trials differs from its rate by chance. The beta-binomial model (Skellam, JRSS B 10,
1948) separates the two: rates of units are beta distributed, and trials are binomial. The prior of
the mean is uniform, and so is that of the square root of the intra-class correlation. An interval
integrates over both on a grid, so it includes the uncertainty of how much units differ.
"""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import Rate

MIN_UNITS = 5
"""Smallest number of units for an interval; fewer do not show how much units differ."""
GRID = 31
"""Number of grid points of the mean, and of the square root of the intra-class correlation."""
_NEGLIGIBLE = 12.0  # log likelihoods that are lower than the maximum by this are neglected


class UnitRate(NamedTuple):
    """The share of events over all units, with the interval of a new unit's rate."""

    rate: Rate
    units: int
    # Posterior mean of the standard deviation of units' rates; NaN if it cannot be estimated.
    deviation: float


def rate_per_unit(k: ArrayLike, n: ArrayLike) -> UnitRate:
    """Return the rate of events from k events in n trials of each unit [units].

    Units without trials are left out. The 95 % interval of a new unit's rate and the deviation
    between units are NaN for fewer than MIN_UNITS units. They are NaN, too, if each unit has one
    trial, because chance then explains any difference.
    """
    hits, trials = np.asarray(k, float), np.asarray(n, float)
    hits, trials = hits[trials > 0], trials[trials > 0]
    hit_count, trial_count, unit_count = int(hits.sum()), int(trials.sum()), len(trials)
    value = hit_count / trial_count if trial_count else np.nan
    if unit_count < MIN_UNITS or trial_count <= unit_count:
        return UnitRate(Rate(hit_count, trial_count, value), unit_count, np.nan)
    mean, root, weight = _posterior(hits, trials)
    low, high = (_mixture_quantile(mean, root, weight, share) for share in (0.025, 0.975))
    deviation = np.nan
    # Without events, or with only events, the deviation would depend only on the prior.
    if 0 < hit_count < trial_count:
        # Standard deviation of a beta distribution. root: root of the intra-class correlation.
        deviation = float((weight * root * np.sqrt(mean * (1.0 - mean))).sum())
    return UnitRate(Rate(hit_count, trial_count, value, low, high), unit_count, deviation)


def _posterior(hits: np.ndarray, trials: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the posterior of the beta-binomial model at the points of a grid: mean, `root` (square
    root of the intra-class correlation), and weight, [GRID**2] each. The grid covers likely values.
    hits, trials: of each unit, [units].
    """
    # Half an event is added to events and to other trials, so that no logarithm is infinite.
    events, others = hits.sum() + 0.5, trials.sum() - hits.sum() + 0.5
    share = events / (trials.sum() + 1.0)
    # The grid of the mean extends six standard errors of its logit to each side. The error grows
    # with the dispersion (chi-squared per unit), if units differ more than chance explains.
    expected = trials * share
    dispersion = ((hits - expected) ** 2 / (expected * (1.0 - share))).sum() / len(hits)
    error = np.sqrt((1.0 / events + 1.0 / others) * max(1.0, dispersion))
    logit = np.log(events / others)
    means = 1.0 / (1.0 + np.exp(-(logit + 6.0 * error * np.linspace(-1.0, 1.0, GRID))))
    # The grid of the root spans the likely points of a coarse grid, and one of its steps (a factor
    # of coarse[1] / coarse[0]) to each side, but not beyond the coarse grid.
    coarse = np.geomspace(1e-4, 0.95, GRID)
    best = _log_likelihood(hits, trials, means[:, None], coarse[None, :]).max(axis=0)
    likely = coarse[best > best.max() - _NEGLIGIBLE]
    lowest = 1e-4 if likely[0] == coarse[0] else likely[0] * coarse[0] / coarse[1]
    roots = np.linspace(lowest, min(0.95, likely[-1] * coarse[1] / coarse[0]), GRID)
    mean, root = (points.ravel() for points in np.meshgrid(means, roots, indexing="ij"))
    # The points are uniform in the logit of the mean. The last term makes the mean's prior uniform.
    log_weight = _log_likelihood(hits, trials, mean, root) + np.log(mean * (1.0 - mean))
    weight = np.exp(log_weight - log_weight.max())
    return mean, root, weight / weight.sum()


def _log_likelihood(
    hits: np.ndarray, trials: np.ndarray, mean: np.ndarray, root: np.ndarray
) -> np.ndarray:
    # Returns the log-likelihood of beta-binomial counts for each pair of the units' mean rate and
    # the square root of the intra-class correlation, which have one shape (or are broadcast).
    from scipy.stats import betabinom

    a, b = _beta_parameters(*np.broadcast_arrays(mean, root))
    return betabinom.logpmf(hits, trials, a[..., None], b[..., None]).sum(axis=-1)


def _beta_parameters(mean: np.ndarray, root: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    # Returns both parameters of the beta distributions of units' rates. Their sum `size` follows
    # from the intra-class correlation: root^2 = 1 / (size + 1).
    size = 1.0 / root**2 - 1.0
    return mean * size, (1.0 - mean) * size


def _mixture_quantile(
    mean: np.ndarray, root: np.ndarray, weight: np.ndarray, share: float
) -> float:
    # Returns the quantile `share` of a mixture of beta distributions with these weights.
    from scipy.optimize import brentq
    from scipy.special import betainc

    a, b = _beta_parameters(mean, root)
    quantile: Any = brentq(lambda x: weight @ betainc(a, b, x) - share, 0.0, 1.0, xtol=1e-9)
    return float(quantile)
