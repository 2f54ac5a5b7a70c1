"""Computes confidence intervals of a rate k/n.

Use Wilson's interval for display. Use Clopper and Pearson's for guarantees, because it never covers
less than promised (Brown, Cai, DasGupta, Statistical Science 16, 2001). Both assume that the n
trials are independent. Repeats of a deterministic run are not independent, so count distinct
faults, or resample clusters (`stats.units`).
"""

import math
import statistics
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

ALPHA = 1 - 0.95
"""Default probability that an interval does not contain the true value."""


class Rate(NamedTuple):
    """k of n with its confidence interval. value, low and high are fractions, NaN if n is 0."""

    k: int = 0
    n: int = 0
    value: float = math.nan
    low: float = math.nan
    high: float = math.nan


class Estimate(NamedTuple):
    """A value with its confidence interval, in one unit. A curve has arrays of one shape."""

    value: Any = math.nan
    low: Any = math.nan
    high: Any = math.nan

    @property
    def negated(self) -> "Estimate":
        """The estimate of the opposite number, whose interval has the bounds exchanged."""
        return Estimate(-self.value, -self.high, -self.low)


def wilson_interval(k: int, n: int) -> Rate:
    """Return a rate with its 95 % Wilson score interval. Raises ValueError unless 0 <= k <= n."""
    return rates_with_intervals([k], [n])[0]


def clopper_pearson(k: int, n: int) -> Rate:
    """Return a rate with its exact 95 % interval. Raises ValueError unless 0 <= k <= n."""
    rate = wilson_interval(k, n)
    if not n:
        return rate
    from statsmodels.stats.proportion import proportion_confint  # slow to import

    low, high = np.asarray(proportion_confint(k, n, ALPHA, "beta"), float).tolist()
    return rate._replace(low=low, high=high)


def share_of_cells(k: int, n: int) -> Rate:
    """Return the share k of n cells of a fixed design. It has no interval, because nothing was
    sampled. Raise ValueError unless 0 <= k <= n.
    """
    return wilson_interval(k, n)._replace(low=math.nan, high=math.nan)


def rates_with_intervals(
    k: ArrayLike, n: ArrayLike, confidence: float = 0.95, half_width: float | None = None
) -> list[Rate]:
    """Return rates k[i] of n[i] with their intervals, computed in one vectorised call. half_width:
    see `rate_bounds`. k and n are whole numbers of one shape [m] or a number each. Raises
    ValueError unless 0 <= k <= n and 0 < confidence < 1.
    """
    hits, trials = np.broadcast_arrays(np.atleast_1d(k).astype(int), np.atleast_1d(n).astype(int))
    outside = np.flatnonzero((hits < 0) | (hits > trials))
    if len(outside):
        raise ValueError(
            f"a rate needs 0 <= k <= n, got k = {hits[outside[0]]}, n = {trials[outside[0]]}"
        )
    low, high = rate_bounds(hits, trials, alpha_of(confidence), half_width)
    with np.errstate(invalid="ignore"):
        value = hits / trials
    columns = [column.tolist() for column in (hits, trials, value, low, high)]
    # A rate without trials has no value.
    return [Rate(*row) if row[1] else Rate() for row in zip(*columns, strict=True)]


def rate_bounds(
    k: np.ndarray, n: np.ndarray, alpha: float = ALPHA, half_width: float | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper Wilson bounds [m] of the rates k/n, NaN if n is 0. k may be a
    fraction, such as an expected count.

    `alpha`: 1 - confidence. half_width: for a study that grows until its intervals have this half
    width (a fraction of 1). The bounds are then those of `anytime_bounds`, which hold at every n
    together, however often one looks. If k is 0 the lower bound is 0; if k is n the upper is 1.
    """
    with np.errstate(all="ignore"):
        if half_width is not None:
            low, high = anytime_bounds(k, n, alpha, half_width)
        else:
            # A command that ends with a rate would wait 0.45 s for the import of statsmodels.
            z = statistics.NormalDist().inv_cdf(1 - alpha / 2)
            centre = (k + z**2 / 2) / (n + z**2)
            half = z * np.sqrt(k * (n - k) / n + z**2 / 4) / (n + z**2)
            low, high = centre - half, centre + half
    low = np.where(n == 0, np.nan, np.where(k == 0, 0.0, low))
    return low, np.where(n == 0, np.nan, np.where(k == n, 1.0, high))


def anytime_bounds(
    k: np.ndarray, n: np.ndarray, alpha: float, half_width: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return lower and upper bounds [m] of the rates k/n.

    Bounds of all n together contain the rate with a probability of at least 1 - alpha, so a study
    may stop at any n. h = `half_width` is the half of the interval's width at which it will stop.
    Rate p has the likelihood L(p) = p^k (1 - p)^(n - k). It is tested by the ratios
    L(p - h) / L(p) and L(p + h) / L(p) (Wald, Ann. Math. Stat. 16, 1945). By Ville's inequality,
    their mean exceeds 1/alpha at any n with a probability of at most alpha. So p is excluded if a
    ratio exceeds 2/alpha. Of all tests, this one reaches `half_width` with the fewest runs.
    """
    from scipy.special import xlogy

    def upper_bound(k: np.ndarray) -> np.ndarray:
        # Returns the lowest rate above k/n that is excluded, by bisection: its likelihood ratio
        # L(rate - half_width) / L(rate), for k events in n runs, rises with the rate.
        low, high = np.zeros(k.shape), np.ones(k.shape)
        for _ in range(50):
            rate = (low + high) / 2
            lower_rate = np.maximum(rate - half_width, 0.0)
            log_ratio = xlogy(k, lower_rate / rate) + xlogy(n - k, (1 - lower_rate) / (1 - rate))
            excluded = log_ratio > math.log(2 / alpha)
            low = np.where(excluded, low, rate)
            high = np.where(excluded, rate, high)
        return high

    # The lower bound of a rate is 1 minus the upper bound of the rate of misses.
    return 1 - upper_bound(n - k), upper_bound(k)


def alpha_of(confidence: float) -> float:
    """Return 1 - confidence, the chance to miss. Raises ValueError unless 0 < confidence < 1."""
    if not 0 < confidence < 1:
        raise ValueError(f"expected a confidence between 0 and 1, such as 0.95, got {confidence}")
    return 1 - confidence


def independent_difference(first: Estimate, second: Estimate) -> Estimate:
    """Return first minus second of two independent estimates, by the square-and-add of their
    intervals (Newcombe, Stat. Med. 17, 1998; Zou and Donner, Stat. Med. 27, 2008).
    """
    value = first.value - second.value
    below = math.hypot(first.value - first.low, second.high - second.value)
    above = math.hypot(first.high - first.value, second.value - second.low)
    return Estimate(value, value - below, value + above)


def rate_difference(k1: int, n1: int, k2: int, n2: int) -> Estimate:
    """Return the rate of k1 of n1 minus that of k2 of n2 independent runs; NaN if n1 or n2 is 0.
    The interval is Newcombe's square-and-add of two Wilson intervals (Stat. Med. 17, 1998, method
    10). For runs of the same faults use `paired`. Raises ValueError on impossible counts.
    """
    # The first two fields of a Rate are k and n.
    first, second = (Estimate(*rate[2:]) for rate in rates_with_intervals([k1, k2], [n1, n2]))
    return independent_difference(first, second)
