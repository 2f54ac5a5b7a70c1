"""A rate over strata that were not sampled as often as they occur."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import alpha_of, bounds, whole


class StratifiedRate(NamedTuple):
    """Weighted rate sum w p with its interval; error is its standard error, sqrt(sum w^2 p (1 -
    p) / n).
    """

    value: float
    low: float
    high: float
    error: float
    n: int


def stratified(
    k: ArrayLike, n: ArrayLike, weight: ArrayLike, confidence: float = 0.95
) -> StratifiedRate:
    """Rate over strata of k[s] hits in n[s] runs that occur in proportion to weight[s]; arrays
    [strata].

    Weights are normalised to sum 1. Estimate and variance: Powell, Martins, Arlat, Crouzet (IEEE
    Trans. Computers 44, 1995). The interval is Wilson's at the effective number of runs, that of a
    plain sample with the same variance (Korn, Graubard, Survey Methodology 24, 1998; Dean, Pagano,
    J. Surv. Stat. Methodol. 3, 2015), here taken at each stratum's Wilson centre, so the interval
    does not collapse where a stratum saw no hit; one stratum gives Wilson's interval itself.
    ValueError where shapes differ, a weight is negative, all are 0, a stratum of positive weight
    has no run, or a count is impossible.
    """
    from scipy.stats import norm

    hits, runs, share = whole(k, "k"), whole(n, "n"), np.asarray(weight, float)
    if not hits.shape == runs.shape == share.shape or hits.ndim != 1:
        raise ValueError(
            f"stratified: k {hits.shape}, n {runs.shape} and weight {share.shape} must be of one"
            " length"
        )
    share = _normalised(share)
    used = share > 0
    if (runs[used] == 0).any():
        raise ValueError(
            "stratified: a stratum of positive weight has no run; run it, or set its weight to 0"
        )
    if ((hits < 0) | (hits > runs)).any():
        raise ValueError(f"stratified: a rate needs 0 <= k <= n, got k = {hits}, n = {runs}")
    hits, runs, share = hits[used], runs[used], share[used]
    rate = hits / runs
    z = norm.isf(alpha_of(confidence) / 2)
    centre = (hits + z**2 / 2) / (runs + z**2)
    overall = share @ centre
    effective = overall * (1 - overall) / np.sum(share**2 * centre * (1 - centre) / runs)
    value = float(share @ rate)
    low, high = bounds(np.array(value * effective), np.array(effective), confidence, "wilson")
    error = float(np.sqrt(np.sum(share**2 * rate * (1 - rate) / runs)))
    return StratifiedRate(value, float(low), float(high), error, int(runs.sum()))


def allocate(total: int, spread: ArrayLike, least: ArrayLike, most: ArrayLike) -> np.ndarray:
    """Runs per stratum, int64 [strata], in proportion to spread[s], none below least[s] nor above
    most[s].

    They sum to `total`, or to the nearest sum that the bounds allow. Where strata without spread
    must take what the others cannot hold, they share it evenly. ValueError where shapes differ, a
    spread is negative or not finite, or bounds are not 0 <= least <= most.
    """
    want, low, high = np.asarray(spread, float), whole(least, "least"), whole(most, "most")
    if not want.shape == low.shape == high.shape or want.ndim != 1:
        raise ValueError(
            f"allocate: spread {want.shape}, least {low.shape} and most {high.shape} must be of one"
            " length"
        )
    if not ((want >= 0) & np.isfinite(want)).all():
        raise ValueError(f"allocate: spreads are finite and not negative, got {want}")
    if not ((low >= 0) & (low <= high)).all():
        raise ValueError(f"allocate: bounds must be 0 <= least <= most, got {low} and {high}")
    total = int(np.clip(total, low.sum(), high.sum()))
    if total > np.where(want > 0, high, low).sum():  # all that has a spread is full
        full = np.where(want > 0, high, low)
        return allocate(total, np.ones(len(want)), full, high)
    exact = np.clip(_level(total, want, low, high) * want, low, high)
    runs = np.floor(exact).astype(np.int64)
    largest = np.argsort(runs - exact, kind="stable")  # remainders, the largest first
    runs[largest[: total - int(runs.sum())]] += 1
    return runs


def _level(total: int, spread: np.ndarray, low: np.ndarray, high: np.ndarray) -> float:
    """The factor at which the clipped multiples of `spread` sum to `total`: their sum is a
    polygon in the factor.
    """
    used = spread > 0
    corners = np.unique(
        np.concatenate([[0.0], low[used] / spread[used], high[used] / spread[used]])
    )
    sums = np.clip(corners[:, None] * spread, low, high).sum(axis=1)
    return float(np.interp(total, sums, corners))


def _normalised(weight: np.ndarray) -> np.ndarray:
    if not (weight >= 0).all() or not np.isfinite(weight).all() or not weight.any():
        raise ValueError(
            f"weights of strata must be finite, not negative and not all 0, got {weight}"
        )
    return weight / weight.sum()
