"""Intervals over pairs of runs: all pairs of one drawn fault count together; enumerated faults have
no interval.
"""

from __future__ import annotations

import math

import numpy as np

from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.comparison import clustered, paired
from ravenjax.stats.intervals import Estimate, Rate, share, wilson

RESAMPLES = 1000
DRAWS = 20_000_000
"""Units drawn for one band of a mean, all resamples together."""


def faults(distinct: np.ndarray, sampled: bool) -> Units | None:
    """The faults of pairs, by a number that is the same in all pairs of one fault; None where
    they were enumerated.
    """
    return units.units(distinct) if sampled else None


def rate(hit: np.ndarray, among: Units | None) -> Rate:
    """Share of pairs: Wilson's where each is of another fault, else by resampling faults."""
    if among is None:
        return share(int(hit.sum()), len(hit))
    if among.count == len(hit):
        return wilson(int(hit.sum()), len(hit))
    return units.rate(hit, among, resamples=_resamples(among.count))


def rate_difference(after: np.ndarray, before: np.ndarray, among: Units | None) -> Estimate:
    """Rate of `after` minus that of `before`: Bonett and Price's where each pair is of another
    fault, and where nothing differs, with as many pairs as there are faults; else by resampling
    faults."""
    if among is None:
        return Estimate(_mean(after.astype(float) - before), math.nan, math.nan)
    if among.count == len(after):
        return paired.rate_difference(after, before)
    if (after == before).all() and among.count >= units.FEWEST:
        return paired.difference_of_counts(0, 0, among.count)
    return _resampled(after.astype(float) - before, among)


def mean_difference(after: np.ndarray, before: np.ndarray, among: Units | None) -> Estimate:
    """Mean of `after` minus `before` by resampling faults; of one pair it has no interval."""
    if among is None or len(after) < 2:
        return Estimate(_mean(after - before), math.nan, math.nan)
    return _resampled(after - before, among)


def p_value(after: np.ndarray, before: np.ndarray, among: Units | None) -> float:
    """Exact, that both are alike: McNemar's test, or both exchanged fault by fault; NaN where
    nothing was drawn.
    """
    if among is None:
        return math.nan
    if among.count == len(after):
        return paired.mcnemar(after, before).p
    return clustered.exchange_p(after, before, among.unit)


def _resampled(difference: np.ndarray, among: Units) -> Estimate:
    band = units.ratio(difference, 1.0, among, resamples=_resamples(among.count))
    return Estimate(_mean(difference), float(band.low), float(band.high))


def _resamples(count: int) -> int:
    return int(np.clip(DRAWS // count, 100, RESAMPLES))


def _mean(difference: np.ndarray) -> float:
    return float(difference.mean()) if len(difference) else math.nan
