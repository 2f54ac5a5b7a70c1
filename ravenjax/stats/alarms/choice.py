"""Chooses the best of several alarms, and decides whether the data are sufficient for the choice.

An alarm has two costs: missed hazards and false alarms. Both are estimated with an interval. Alarm
A is excluded if an alarm B is better even with B's costs at the upper ends of their intervals and
A's at the lower ends. Any of the remaining alarms may be the best.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.alarms.false_alarms import rate_bounds
from ravenjax.stats.intervals import Estimate
from ravenjax.stats.paired import difference_of_counts

MAX_FACTOR = 1e9
"""Largest factor on the hours that is tried. If it does not decide, more hours do not help."""


class AlarmCounts(NamedTuple):
    """Missed hazards and false alarms of several alarms on the same hazards."""

    missed: np.ndarray  # int [alarms], number of missed hazards
    # int [alarms, alarms], number of hazards that the first misses and the second detects.
    missed_by_first: np.ndarray
    hazards: int  # number of hazards
    count: np.ndarray  # int [alarms], number of false alarms
    hours: np.ndarray  # [alarms], hours of fault-free motion with these false alarms
    # True if the hazards were drawn at random. Otherwise the missed share has no interval.
    sampled: bool = True


def missed_difference(alarms: AlarmCounts) -> Estimate:
    """Return the difference of missed shares for each pair of alarms, [first, second]. It is the
    share that only the first alarm misses minus the share that only the second misses.
    """
    if not alarms.sampled:
        value = (alarms.missed_by_first - alarms.missed_by_first.T) / alarms.hazards
        return Estimate(value, value, value)
    return difference_of_counts(alarms.missed_by_first, alarms.missed_by_first.T, alarms.hazards)


def false_rates(alarms: AlarmCounts, times: float = 1.0) -> Estimate:
    """Return false alarms per hour with exact Poisson intervals, arrays [alarms]. The intervals are
    those that `times` as many hours with the same rates would give. With infinitely many hours they
    have no width.
    """
    if np.isinf(times):
        value = alarms.count / alarms.hours
        return Estimate(value, value, value)
    count, hours = np.round(alarms.count * times), alarms.hours * times
    return Estimate(count / hours, *rate_bounds(count, hours))


def cheapest_alarms(alarms: AlarmCounts, weight: float, times: float = 1.0) -> np.ndarray:
    """Return which alarms may have the lowest cost, bool [alarms]. A missed hazard costs as much as
    `weight` false alarms. There is one hazard per hour. times: see `false_rates`.
    """
    missed, false = missed_difference(alarms), false_rates(alarms, times)
    # Cost of a first alarm minus that of a second, at least, [first, second]. If it is above 0, the
    # second is certainly better.
    difference = weight * missed.low + false.low[:, None] - false.high[None, :]
    return ~(difference > 0).any(axis=1)


def alarms_within_limit(
    alarms: AlarmCounts, per_hour: float, times: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return which alarms may be the best, and which certainly keep the limit: both bool [alarms].
    The best alarm misses the fewest hazards of those with at most `per_hour` false alarms an hour.
    Alarms are compared by the ends of their intervals. times: see `false_rates`.
    """
    false = false_rates(alarms, times)
    # The tolerance allows for rounding.
    keeps_limit = false.high <= per_hour * (1 + 1e-9)
    # [first, second]: the first alarm misses more than the second, and the second keeps the limit.
    is_worse = (missed_difference(alarms).low > 0) & keeps_limit[None, :]
    return (false.low <= per_hour) & ~is_worse.any(axis=1), keeps_limit


def factor_to_decide(possible: Callable[[float], np.ndarray]) -> float:
    """Return by which factor to multiply the hours so that still more hours exclude no alarm.

    Rates are assumed to be unchanged. The result is NaN if the present hours are enough, and
    infinite if the factor would be above MAX_FACTOR. possible: factor on the hours -> which alarms
    may then be the best, bool [alarms], such as `cheapest_alarms`.
    """
    final = possible(np.inf)
    if np.array_equal(possible(1.0), final):
        return np.nan
    low, high = 1.0, 2.0
    while high < MAX_FACTOR and not np.array_equal(possible(high), final):
        low, high = high, 2 * high
    if high >= MAX_FACTOR:
        return np.inf
    # Bisection on a logarithmic scale, to half a percent.
    while high / low > 1.005:
        middle = np.sqrt(low * high)
        is_enough = np.array_equal(possible(middle), final)
        low, high = (low, middle) if is_enough else (middle, high)
    return float(high)


def unbeaten_choices(first: ArrayLike, second: ArrayLike) -> np.ndarray:
    """Return which of n choices are on the Pareto front: bool [n].

    A choice is not on the front if another choice has at most the same costs and a lower cost in
    one of them. first, second: costs [n], in any unit. Equal choices are treated equally. A choice
    with a NaN cost is not on the front and excludes no other choice.
    """
    costs = np.stack([np.asarray(first, float), np.asarray(second, float)], axis=1)
    # [first, second]: the second choice costs no more in both costs; less in at least one cost.
    costs_no_more = np.all(costs[None] <= costs[:, None], axis=2)
    costs_less = np.any(costs[None] < costs[:, None], axis=2)
    return ~np.any(costs_no_more & costs_less, axis=1) & ~np.any(np.isnan(costs), axis=1)
