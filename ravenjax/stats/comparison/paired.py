"""Compares two settings run by run, over the same faults and random numbers."""

import math

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import ALPHA, Estimate


def mcnemar_test(first: ArrayLike, second: ArrayLike) -> float:
    """Return the p-value of McNemar's exact test of two bool [n] over the same runs; 1 if no pair
    is discordant.

    Raises ValueError if the lengths differ.
    """
    from scipy.stats import binomtest

    one, two = _pairs(first, second)
    only, other = int((one & ~two).sum()), int((two & ~one).sum())
    return float(binomtest(only, only + other).pvalue) if only + other else 1.0


def rate_difference(first: ArrayLike, second: ArrayLike) -> Estimate:
    """Return the rate of `first` minus the rate of `second`, two bool [n] over the same runs, with
    its interval; NaN if n is 0.

    The interval is the adjusted Wald interval of Bonett and Price (J. Educ. Behav. Stat. 37, 2012),
    recommended by Fagerland, Lydersen and Laake (Stat. Med. 33, 2014). No installed library has an
    interval for pairs. Raises ValueError if the lengths differ.
    """
    one, two = _pairs(first, second)
    return difference_of_counts(int((one & ~two).sum()), int((two & ~one).sum()), len(one))


def difference_of_counts(first_only: ArrayLike, second_only: ArrayLike, n: int) -> Estimate:
    """Return the result of `rate_difference` from counts.

    `first_only`, `second_only`: of `n` pairs, the number with the event only in the first or only
    in the second setting; numbers, or arrays of one shape.
    """
    from scipy.stats import norm

    first, second = np.asarray(first_only), np.asarray(second_only)
    if not n:
        return Estimate()
    z = norm.isf(ALPHA / 2)
    p, q = (first + 1) / (n + 2), (second + 1) / (n + 2)
    half = z * np.sqrt((p + q - (p - q) ** 2) / (n + 2))
    parts = (first - second) / n, np.maximum(p - q - half, -1.0), np.minimum(p - q + half, 1.0)
    return Estimate(*(part if part.ndim else float(part) for part in parts))


def exchange_p(first: ArrayLike, second: ArrayLike, unit: ArrayLike) -> float:
    """Return the exact two-sided p-value of the hypothesis that two conditions do not differ.

    first, second: bool [n], the same rows under both conditions. unit: number of each row's unit.
    If the conditions do not differ, they can be exchanged in any unit, so both signs of the unit's
    difference of counts are equally likely. All exchanges are enumerated. With one row per unit
    this is McNemar's exact test. The result is NaN if no unit has a difference.
    """
    difference = np.asarray(first, bool).astype(int) - np.asarray(second, bool).astype(int)
    size = np.abs(np.bincount(np.asarray(unit), difference).round().astype(int))
    if not size.any():
        return math.nan
    total = abs(int(difference.sum()))
    law = np.ones(1)  # distribution of the sum, from -reach to reach
    for step in size[size > 0]:
        law = 0.5 * (np.pad(law, (2 * step, 0)) + np.pad(law, (0, 2 * step)))
    sums = np.abs(np.arange(len(law)) - len(law) // 2)
    return min(1.0, float(law[sums >= total].sum()))


def _pairs(first: ArrayLike, second: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    # Converts two outcomes to bool arrays and checks that they have the same runs.
    one, two = np.asarray(first, bool), np.asarray(second, bool)
    if one.shape != two.shape or one.ndim != 1:
        raise ValueError(
            f"expected two arrays of one shape [pairs], got {one.shape} and {two.shape}"
        )
    return one, two
