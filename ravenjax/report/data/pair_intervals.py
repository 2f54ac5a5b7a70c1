"""Computes confidence intervals of differences between paired runs, such as runs with and without
the operator's reaction.

The pairs of one drawn fault are one unit of the bootstrap. Enumerated faults have no interval.
"""

import math
from typing import NamedTuple

import numpy as np

from ravenjax.stats import paired, units
from ravenjax.stats.intervals import Estimate, Rate, share_of_cells, wilson_interval
from ravenjax.stats.units import Units

RESAMPLES = 1000
DRAWS = 20_000_000
"""Units drawn for one confidence band of a mean, over all resamples."""


class PairedRates(NamedTuple):
    """The rate of one event in the runs of each side of some pairs."""

    before: Rate
    after: Rate
    change: Estimate  # after minus before, a fraction
    before_only: int  # pairs in which only the run before has it
    after_only: int
    p: float  # exact p-value of the hypothesis that both rates are equal; NaN if nothing was drawn


def pair_faults(distinct: np.ndarray, sampled: bool) -> Units | None:
    """Return the fault number of each pair; None if faults were enumerated."""
    return units.group_units(distinct) if sampled else None


def pair_rate(hit: np.ndarray, faults: Units | None) -> Rate:
    """Return the share of true values in `hit` (bool [pairs]) with a confidence interval.

    The interval is Wilson's if each pair has its own fault, otherwise a bootstrap over faults.
    `faults`: the fault of each pair; None if they were enumerated, and there is no interval.
    """
    if faults is None:
        return share_of_cells(int(hit.sum()), len(hit))
    if faults.count == len(hit):
        return wilson_interval(int(hit.sum()), len(hit))
    return units.rate_band(hit, faults, resamples=_resamples(faults.count))


def compare_rates(after: np.ndarray, before: np.ndarray, faults: Units | None) -> PairedRates:
    """Return the rates of an event in the runs of each side of some pairs, and their difference.

    after, before: whether the event occurred, bool [pairs]. faults: see `pair_rate`. If each pair
    has its own fault, or if no pair differs, the interval of the difference is Bonett and Price's.
    Else faults are resampled.
    """
    difference = after.astype(float) - before
    lost, gained = int((before & ~after).sum()), int((after & ~before).sum())
    if faults is None:
        change, p = Estimate(_mean(difference)), math.nan
    elif faults.count == len(after):
        change = paired.difference_of_counts(gained, lost, len(after))
        p = paired.mcnemar_test(gained, lost)
    else:
        p = paired.exchange_p(after, before, faults.unit)
        # If no pair differs, resampling would give an interval of width 0.
        unchanged = not difference.any() and faults.count >= units.MIN_UNITS
        change = (
            paired.difference_of_counts(0, 0, faults.count)
            if unchanged
            else _resampled(difference, faults)
        )
    return PairedRates(pair_rate(before, faults), pair_rate(after, faults), change, lost, gained, p)


def mean_difference(after: np.ndarray, before: np.ndarray, faults: Units | None) -> Estimate:
    """Return the mean of `after` minus `before`, with an interval if there are several pairs."""
    if faults is None or len(after) < 2:
        return Estimate(_mean(after - before))
    return _resampled(after - before, faults)


def _resampled(difference: np.ndarray, faults: Units) -> Estimate:
    band = units.ratio_band(difference, 1.0, faults, resamples=_resamples(faults.count))
    return Estimate(_mean(difference), float(band.low), float(band.high))


def _resamples(count: int) -> int:
    return int(np.clip(DRAWS // count, 100, RESAMPLES))


def _mean(difference: np.ndarray) -> float:
    return float(difference.mean()) if len(difference) else math.nan
