"""The rates of two independent groups compared."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from ravenjax.stats.intervals import Estimate, Rate, alpha_of, rates

_NOTHING = Estimate(math.nan, math.nan, math.nan)


class RateComparison(NamedTuple):
    """Two rates, their difference (first - second) and ratio (first / second), and the p-value of their equality."""

    first: Rate
    second: Rate
    difference: Estimate
    ratio: Estimate
    p: float


def compare(k1: int, n1: int, k2: int, n2: int, confidence: float = 0.95) -> RateComparison:
    """Risk difference and relative risk of k1 of n1 against k2 of n2 independent runs.

    Difference: Newcombe's square-and-add of two Wilson intervals (Stat. Med. 17, 1998, method 10). Ratio: the same idea
    for a quotient. p: Fisher's exact test. All NaN where a group is empty; the ratio is infinite or NaN where the
    second count is 0, its bounds still hold. Runs of the same faults are not independent: use `paired`. ValueError on
    impossible counts.
    """
    from scipy.stats import fisher_exact
    from statsmodels.stats.proportion import confint_proportions_2indep  # slow to import

    first, second = rates([k1, k2], [n1, n2], confidence)
    if not first.n or not second.n:
        return RateComparison(first, second, _NOTHING, _NOTHING, math.nan)
    counts = (first.k, first.n, second.k, second.n)
    low, high = confint_proportions_2indep(*counts, "newcomb", "diff", alpha_of(confidence))
    difference = Estimate(first.value - second.value, float(low), float(high))
    table = [[first.k, first.n - first.k], [second.k, second.n - second.k]]
    exact: Any = fisher_exact(table)
    return RateComparison(first, second, difference, _ratio(first, second), float(exact.pvalue))


def _ratio(first: Rate, second: Rate) -> Estimate:
    """first / second with the interval that Donner and Zou (Stat. Methods Med. Research 21, 2012) recover from the two.

    statsmodels' intervals of a ratio collapse to one point or leave the estimate outside where a rate is 0 or 1.
    """
    product = first.value * second.value

    def root(one: float, other: float) -> float:  # one: first p^2 - distance^2 of its bound, other: of second's
        return product + math.sqrt(max(0.0, product**2 - one * other))

    below, above = (bound * (2 * first.value - bound) for bound in (first.low, first.high))
    least, most = (bound * (2 * second.value - bound) for bound in (second.low, second.high))
    low = below / root(below, most) if below > 0 else 0.0
    high = root(above, least) / least if least > 0 else math.inf
    if second.k:
        return Estimate(first.value / second.value, low, high)
    return Estimate(math.inf if first.k else math.nan, low, high)
