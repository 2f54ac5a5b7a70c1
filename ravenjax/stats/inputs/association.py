"""Does a rate depend on an input? Which conclusions hang on which uncertain parameter."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import Estimate, Rate, rate_difference, rates
from ravenjax.stats.multiplicity import holm

_FEW = 5  # expected count below which the chi-squared law no longer holds (Cochran 1954)
_DRAWS = 9999  # tables drawn then


class InputLevel(NamedTuple):
    """Runs of one level of an input: its name, the input's least and greatest value there."""

    name: str
    least: float
    greatest: float
    rate: Rate


class Dependence(NamedTuple):
    """Whether a rate depends on one input.

    levels: the lowest, (middle) and highest third of the input. difference: rate in the last level
    minus rate in the first. p: of independence, NaN where the input or the outcome never varies;
    adjusted: by Holm over all inputs asked about; depends: adjusted p below 1 - confidence.
    """

    name: str
    n: int  # runs in which the input has a value
    p: float
    adjusted: float
    depends: bool
    levels: tuple[InputLevel, ...]
    difference: Estimate


def dependences(
    hit: ArrayLike, inputs: Mapping[str, ArrayLike], confidence: float = 0.95, seed: int = 0
) -> list[Dependence]:
    """Whether the rate of `hit` (bool [n]) depends on each numeric input [n], the clearest first.

    Mann-Whitney's test sees a rate that rises or falls, the chi-squared test over thirds one that
    is worst at both ends or in the middle; p is twice the lesser (Bonferroni). Where a third
    expects fewer than 5 hits or misses, the latter is by tables drawn with `seed`. Runs are taken
    as independent, and a run without a value (NaN) is left out of that input.
    """
    outcome = np.asarray(hit).astype(bool)
    measured = [
        _measured(name, outcome, np.asarray(values, float), confidence, seed)
        for name, values in inputs.items()
    ]
    return judge(measured, confidence)


def judge(measured: Sequence[Dependence], confidence: float) -> list[Dependence]:
    """The same with p adjusted for all of them, the clearest first."""
    findings = holm({one.name: one.p for one in measured}, confidence)
    results = [
        one._replace(adjusted=findings[one.name].adjusted, depends=findings[one.name].rejected)
        for one in measured
    ]
    return sorted(results, key=lambda one: (np.isnan(one.p), one.p, -abs(one.difference.value)))


def _measured(
    name: str, hit: np.ndarray, values: np.ndarray, confidence: float, seed: int
) -> Dependence:
    present = ~np.isnan(values)
    hit, values = hit[present], values[present]
    code, names = thirds(values)
    n = np.bincount(code, minlength=len(names))
    rate_of = rates(np.bincount(code, hit, minlength=len(names)).astype(int), n, confidence)
    levels = [
        InputLevel(label, values[code == i].min(), values[code == i].max(), rate)
        for i, (label, rate) in enumerate(zip(names, rate_of, strict=True))
        if rate.n
    ]
    p = _p(hit, code[:, None] == np.flatnonzero(n), values, seed)
    difference = Estimate(np.nan, np.nan, np.nan)
    if len(levels) > 1:
        first, last = levels[0].rate, levels[-1].rate
        difference = rate_difference(last.k, last.n, first.k, first.n, confidence)
    return Dependence(name, len(hit), p, p, False, tuple(levels), difference)


def thirds(values: np.ndarray) -> tuple[np.ndarray, list[str]]:
    """Level of each value [n] by its rank, int [n], and the levels' names: equal values stay
    together, and both extremes have a level of their own."""
    from scipy.stats import rankdata

    if not len(values) or values.min() == values.max():
        return np.zeros(len(values), int), ["constant"]
    place = (rankdata(values) - 0.5) / len(values)
    low, high = (
        (place < 1 / 3) | (values == values.min()),
        (place > 2 / 3) | (values == values.max()),
    )
    return np.where(low, 0, np.where(high, 2, 1)), ["lowest third", "middle third", "highest third"]


def _p(hit: np.ndarray, member: np.ndarray, values: np.ndarray, seed: int) -> float:
    """p of independence of hit [n] from its level (one-hot [n, levels]) and from the values [n]."""
    from scipy.stats import MonteCarloMethod, chi2_contingency, mannwhitneyu
    from scipy.stats.contingency import expected_freq

    table = np.stack([member[hit].sum(axis=0), member[~hit].sum(axis=0)])
    if table.shape[1] < 2 or not table.sum(axis=1).all():
        return float("nan")
    sparse = expected_freq(table).min() < _FEW
    method = (
        MonteCarloMethod(n_resamples=_DRAWS, rng=np.random.default_rng(seed)) if sparse else None
    )
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        association: Any = chi2_contingency(table, correction=False, method=method)
    levels = float(association.pvalue)
    trend: Any = mannwhitneyu(values[hit], values[~hit])
    return min(1.0, 2 * min(levels, float(trend.pvalue)))
