"""Compares two settings run by run, over the same faults and random numbers."""

import math

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import ALPHA, Estimate


def mcnemar_test(first_only: int, second_only: int) -> float:
    """Return the p-value of McNemar's exact test of an event under two conditions; 1 if no pair
    differs. first_only, second_only: number of pairs with the event under one condition only.
    """
    from scipy.stats import binomtest

    differing = first_only + second_only
    return float(binomtest(first_only, differing).pvalue) if differing else 1.0


def difference_of_counts(first_only: ArrayLike, second_only: ArrayLike, n: int) -> Estimate:
    """Return the rate of an event in the first setting minus its rate in the second setting, over
    the same `n` runs, with its interval; NaN if n is 0.

    `first_only`, `second_only`: number of runs with the event only in the first or only in the
    second setting; numbers, or arrays of one shape. The interval is the adjusted Wald interval of
    Bonett and Price (J. Educ. Behav. Stat. 37, 2012), recommended by Fagerland, Lydersen and Laake
    (Stat. Med. 33, 2014). No installed library has an interval for pairs.
    """
    from scipy.stats import norm

    first, second = np.asarray(first_only), np.asarray(second_only)
    if not n:
        return Estimate()
    z = norm.isf(ALPHA / 2)
    # The adjusted shares of pairs with the event only in the first or only in the second setting.
    p, q = (first + 1) / (n + 2), (second + 1) / (n + 2)
    half = z * np.sqrt((p + q - (p - q) ** 2) / (n + 2))
    value = (first - second) / n
    low, high = np.maximum(p - q - half, -1.0), np.minimum(p - q + half, 1.0)
    return Estimate(*(x if x.ndim else float(x) for x in (value, low, high)))


def exchange_p(first: ArrayLike, second: ArrayLike, unit: ArrayLike) -> float:
    """Return the exact two-sided p-value of the hypothesis that two conditions do not differ.

    first, second: bool [n], the same rows under both conditions. unit: number of each row's unit.
    If the conditions do not differ, they can be exchanged in any unit, so both signs of the unit's
    difference of counts are equally likely. All exchanges are enumerated. With one row per unit
    this is McNemar's exact test. The result is NaN if no unit has a difference.
    """
    difference = np.asarray(first, bool).astype(int) - np.asarray(second, bool).astype(int)
    unit_difference = np.abs(np.bincount(np.asarray(unit), difference).round().astype(int))
    if not unit_difference.any():
        return math.nan
    observed_sum = abs(int(difference.sum()))
    # Distribution of the sum of the units' differences, with 0 in the middle. A unit with the
    # difference d moves it by d up or down, and so makes the range longer by 2 d.
    probability = np.ones(1)
    for d in unit_difference[unit_difference > 0]:
        probability = 0.5 * (np.pad(probability, (2 * d, 0)) + np.pad(probability, (0, 2 * d)))
    sums = np.abs(np.arange(len(probability)) - len(probability) // 2)
    return min(1.0, float(probability[sums >= observed_sum].sum()))
