"""Confidence intervals of a rate k/n.

Wilson for display, Clopper-Pearson for guarantees (never covers less than promised). Both from scipy.stats.binomtest.
They take the n trials as independent: repeats of a deterministic run are not, so count distinct faults.
"""

from __future__ import annotations

from typing import Any, Literal, NamedTuple

import numpy as np
import pandas as pd
from scipy.stats import binomtest


class Rate(NamedTuple):
    """k of n with its confidence interval; value, low and high are fractions, NaN where n is 0."""

    k: int
    n: int
    value: float
    low: float
    high: float


def wilson(k: int, n: int, confidence: float = 0.95) -> Rate:
    """Rate with its Wilson score interval. ValueError unless 0 <= k <= n and 0 < confidence < 1."""
    return _rate(k, n, confidence, "wilson")


def clopper_pearson(k: int, n: int, confidence: float = 0.95) -> Rate:
    """Rate with its exact (Clopper-Pearson) interval. ValueError unless 0 <= k <= n and 0 < confidence < 1."""
    return _rate(k, n, confidence, "exact")


def rule_of_three(n: int) -> float:
    """Upper bound (95 %, one-sided) of a rate of which no case was seen in n trials: about 3/n, at most 1."""
    if n < 0:
        raise ValueError(f"rule_of_three: n must not be negative, got {n}")
    return min(1.0, 3.0 / n) if n else 1.0


def _rate(k: int, n: int, confidence: float, method: Literal["wilson", "exact"]) -> Rate:
    k, n = int(k), int(n)
    if not 0 <= k <= n:
        raise ValueError(f"a rate needs 0 <= k <= n, got k = {k}, n = {n}")
    if n == 0:
        return Rate(0, 0, np.nan, np.nan, np.nan)
    interval = binomtest(k, n).proportion_ci(confidence, method)
    return Rate(k, n, k / n, float(interval.low), float(interval.high))


def rate_table(hits: Any, groups: pd.Series | list[pd.Series], confidence: float = 0.95) -> pd.DataFrame:
    """Wilson rate per group of the Series of truth values `hits`: columns k, n, value, low, high, indexed by group."""
    counts = hits.astype(bool).groupby(groups, observed=True, sort=True).agg(["sum", "size"])
    rates = [wilson(k, n, confidence) for k, n in counts.itertuples(index=False)]
    return pd.DataFrame(rates, index=counts.index, columns=list(Rate._fields))
