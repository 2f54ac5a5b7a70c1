"""Which of several alarms is best, and whether the data decide it: those that no other is shown to
beat.

An alarm has two costs: hazards that it misses, and false alarms. Both are known with an interval;
an alarm is out where another is better at the ends of the intervals that speak least for it. The
alarms that are left may be the best.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.alarms.false_alarms import rate_bounds
from ravenjax.stats.comparison.paired import difference_of_counts
from ravenjax.stats.intervals import Estimate

MOST_TIMES = 1e9
"""Largest factor by which hours are extended; more would not decide."""


class AlarmCounts(NamedTuple):
    """Missed hazards and false alarms of several alarms on the same hazards."""

    missed: np.ndarray  # int [alarms]
    only: np.ndarray  # int [alarms, alarms], hazards that the first misses and the second does not
    hazards: int
    count: np.ndarray  # int [alarms], false alarms
    hours: np.ndarray  # [alarms], of fault-free motion in which they came
    sampled: bool = True  # whether the hazards were; else what is missed of them is known as it is


def missed_difference(alarms: AlarmCounts, confidence: float = 0.95) -> Estimate:
    """Share of hazards missed by the first minus that by the second, arrays [alarms, alarms], of
    the same hazards.
    """
    if not alarms.sampled:
        value = (alarms.only - alarms.only.T) / alarms.hazards
        return Estimate(value, value, value)
    return difference_of_counts(alarms.only, alarms.only.T, alarms.hazards, confidence)


def false_rates(alarms: AlarmCounts, times: float = 1.0, confidence: float = 0.95) -> Estimate:
    """False alarms an hour with exact Poisson intervals, arrays [alarms]; for `times` as many
    hours at the same rates. Infinite times: without an interval."""
    if np.isinf(times):
        value = alarms.count / alarms.hours
        return Estimate(value, value, value)
    count, hours = np.round(alarms.count * times), alarms.hours * times
    return Estimate(count / hours, *rate_bounds(count, hours, confidence))


def cheapest(alarms: AlarmCounts, weight: float, times: float = 1.0) -> np.ndarray:
    """Which may be cheapest, bool [alarms], where a missed hazard costs `weight` false alarms
    and one comes an hour.
    """
    missed, false = missed_difference(alarms), false_rates(alarms, times)
    dearer = weight * missed.low + false.low[:, None] - false.high[None, :]
    return ~(dearer > 0).any(axis=1)


def rare(alarms: AlarmCounts, per_hour: float, times: float = 1.0) -> tuple[np.ndarray, np.ndarray]:
    """Which alarms may miss fewest hazards while they keep the limit of false alarms an hour, and
    which certainly keep it: bool [alarms] each; `times` as of `false_rates`."""
    false = false_rates(alarms, times)
    keeps = false.high <= per_hour * (1 + 1e-9)
    worse = (missed_difference(alarms).low > 0) & keeps[None, :]
    return (false.low <= per_hour) & ~worse.any(axis=1), keeps


def hours_to_decide(possible: Callable[[float], np.ndarray]) -> float:
    """How many times the hours leave no more than endless hours would, the rates staying as they
    are; NaN where what is there does already.

    possible: as of `cheapest`, by the times.
    """
    end = possible(np.inf)
    if np.array_equal(possible(1.0), end):
        return np.nan
    low, high = 1.0, 2.0
    while high < MOST_TIMES and not np.array_equal(possible(high), end):
        low, high = high, 2 * high
    if high >= MOST_TIMES:
        return np.inf
    while high / low > 1.005:
        middle = np.sqrt(low * high)
        low, high = (low, middle) if np.array_equal(possible(middle), end) else (middle, high)
    return float(high)


def front(first: ArrayLike, second: ArrayLike) -> np.ndarray:
    """Which of n choices no other beats: bool [n], True where none is as low in both costs and
    lower in one.

    Two costs [n], less is better, each in any unit; equal choices stand or fall together. A choice
    with a NaN cost is never on the front and beats none.
    """
    costs = np.stack([np.asarray(first, float), np.asarray(second, float)], axis=1)
    low = np.all(costs[None] <= costs[:, None], axis=2)
    lower = np.any(costs[None] < costs[:, None], axis=2)
    return ~np.any(low & lower, axis=1) & ~np.any(np.isnan(costs), axis=1)
