"""How large a difference is, free of its unit: standardised differences of means."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import Estimate, alpha_of

_NONE = Estimate(math.nan, math.nan, math.nan)


def hedges_g(first: ArrayLike, second: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Mean of `first` [n1] minus mean of `second` [n2] in pooled standard deviations, free of small
    samples' bias.

    Cohen's d times Hedges' factor; the interval inverts the noncentral t distribution (Hedges,
    Olkin, Statistical Methods for Meta-Analysis, 1985), which takes normal values of equal
    variance. NaN with fewer than 2 in a group or no variance. ValueError where a value is not
    finite.
    """
    one, two = _values(first), _values(second)
    freedom = len(one) + len(two) - 2
    if min(len(one), len(two)) < 2:
        return _NONE
    spread = math.sqrt(
        (one.var(ddof=1) * (len(one) - 1) + two.var(ddof=1) * (len(two) - 1)) / freedom
    )
    scale = math.sqrt(len(one) * len(two) / (len(one) + len(two)))  # of the noncentrality
    return _standardised(float(one.mean() - two.mean()), spread, scale, freedom, confidence)


def paired_g(first: ArrayLike, second: ArrayLike, confidence: float = 0.95) -> Estimate:
    """Mean of first - second [n], pairs, in standard deviations of the differences, without small
    samples' bias.

    Interval by the noncentral t distribution. NaN and errors as `hedges_g`.
    """
    one, two = _values(first), _values(second)
    if one.shape != two.shape:
        raise ValueError(f"pairs come one by one: got {len(one)} and {len(two)} values")
    difference = one - two
    if len(difference) < 2:
        return _NONE
    spread = float(difference.std(ddof=1))
    return _standardised(
        float(difference.mean()), spread, math.sqrt(len(one)), len(one) - 1, confidence
    )


def _standardised(
    difference: float, spread: float, scale: float, freedom: int, confidence: float
) -> Estimate:
    """Difference / spread with its interval; scale: noncentrality of t is scale times the true
    effect.
    """
    from scipy.special import gammaln
    from scipy.stats import nct

    if not spread > 0:
        return _NONE
    unbiased = (
        math.exp(gammaln(freedom / 2) - gammaln((freedom - 1) / 2)) / math.sqrt(freedom / 2)
        if freedom > 1
        else 0
    )
    t, tail = difference / spread * scale, alpha_of(confidence) / 2
    low = _root(lambda noncentral: float(nct.sf(t, freedom, noncentral)) - tail, t)
    high = _root(lambda noncentral: tail - float(nct.cdf(t, freedom, noncentral)), t)
    return Estimate(unbiased * difference / spread, unbiased * low / scale, unbiased * high / scale)


def _root(rising: Callable[[float], float], start: float) -> float:
    """Where a rising function is 0."""
    from scipy.optimize import brentq

    reach = 4.0
    while reach < 1e4 and not (rising(start - reach) < 0 < rising(start + reach)):
        reach *= 1.5
    if reach >= 1e4:
        return math.nan
    root: Any = brentq(rising, start - reach, start + reach)
    return float(root)


def _values(given: ArrayLike) -> np.ndarray:
    values = np.asarray(given, float)
    if values.ndim != 1 or not np.isfinite(values).all():
        raise ValueError(
            f"an effect size needs finite values in one dimension, got shape {values.shape}"
        )
    return values
