"""A rate over strata that were not sampled as often as they occur."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import Estimate, alpha_of, bounds


def stratified(k: ArrayLike, n: ArrayLike, weight: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Rate sum w p over strata of k[s] hits in n[s] runs that occur in proportion to weight[s];
    arrays [strata], each weight and each n above 0.

    Weights are normalised to sum 1. Estimate and variance: Powell, Martins, Arlat, Crouzet (IEEE
    Trans. Computers 44, 1995). The interval is Wilson's at the effective number of runs, that of a
    plain sample with the same variance (Korn, Graubard, Survey Methodology 24, 1998; Dean, Pagano,
    J. Surv. Stat. Methodol. 3, 2015), here taken at each stratum's Wilson centre, so the interval
    does not collapse where a stratum saw no hit; one stratum gives Wilson's interval itself.
    """
    from scipy.stats import norm

    hits, runs, share = np.asarray(k), np.asarray(n), np.asarray(weight, float)
    share = share / share.sum()
    z = norm.isf(alpha_of(confidence) / 2)
    centre = (hits + z**2 / 2) / (runs + z**2)
    overall = share @ centre
    effective = overall * (1 - overall) / np.sum(share**2 * centre * (1 - centre) / runs)
    value = float(share @ (hits / runs))
    low, high = bounds(np.array(value * effective), np.array(effective), confidence, "wilson")
    return Estimate(value, float(low), float(high))


def allocate(total: int, spread: ArrayLike, least: ArrayLike, most: ArrayLike) -> np.ndarray:
    """Runs per stratum, int64 [strata], in proportion to spread[s], none below least[s] nor above
    most[s].

    They sum to `total`, or to the nearest sum that the bounds allow. Where strata without spread
    must take what the others cannot hold, they share it evenly.
    """
    want, low, high = np.asarray(spread, float), np.asarray(least), np.asarray(most)
    total = int(np.clip(total, low.sum(), high.sum()))
    full = np.where(want > 0, high, low)
    if total > full.sum():
        return allocate(total, np.ones(len(want)), full, high)
    exact = np.clip(_level(total, want, low, high) * want, low, high)
    runs = np.floor(exact).astype(np.int64)
    # remainders, the largest first
    largest = np.argsort(runs - exact, kind="stable")
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
