"""The rates of two independent groups compared."""

from __future__ import annotations

import math

from ravenjax.stats.intervals import Estimate, alpha_of, rates


def rate_difference(k1: int, n1: int, k2: int, n2: int, confidence: float = 0.95) -> Estimate:
    """Rate of k1 of n1 minus rate of k2 of n2 independent runs, with its interval; NaN where a
    group is empty.

    Newcombe's square-and-add of two Wilson intervals (Stat. Med. 17, 1998, method 10). Runs of the
    same faults are not independent: use `paired`. ValueError on impossible counts.
    """
    from statsmodels.stats.proportion import confint_proportions_2indep  # slow to import

    first, second = rates([k1, k2], [n1, n2], confidence)
    if not first.n or not second.n:
        return Estimate(math.nan, math.nan, math.nan)
    counts = (first.k, first.n, second.k, second.n)
    low, high = confint_proportions_2indep(*counts, "newcomb", "diff", alpha_of(confidence))
    return Estimate(first.value - second.value, float(low), float(high))
