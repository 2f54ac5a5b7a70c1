"""Computes false alarms per hour of fault-free operation.

A percentile of samples does not show how often a detector disturbs, because alarms come in bursts.
A run therefore counts at most once, if its highest score exceeds the threshold. If an alarm ends
the run, only the time until the alarm counts.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import ALPHA, clopper_pearson


class AlarmRate(NamedTuple):
    """Number and rate of alarms, with the exact Poisson interval; NaN if hours is 0."""

    count: int
    hours: float = 0.0
    per_hour: float = math.nan
    low: float = math.nan
    high: float = math.nan


def alarm_rate(count: int, hours: float) -> AlarmRate:
    """Return the rate of alarms with its exact 95 % Poisson interval (Garwood 1936)."""
    if not hours:
        return AlarmRate(int(count))
    low, high = rate_bounds(count, hours)
    return AlarmRate(int(count), float(hours), count / hours, float(low), float(high))


def hours_to_bound(per_hour: float, count: int = 0) -> float:
    """Return the hours after which `count` alarms show a rate of at most `per_hour`. After these
    hours the upper end of the exact interval (`alarm_rate`) is `per_hour`. Without an alarm, 3.69 /
    per_hour hours are needed at 95 %.
    """
    # The upper end after one hour. The upper end is inversely proportional to the hours.
    return alarm_rate(count, 1.0).high / per_hour


def ending_rate(alarm: np.ndarray, hours: np.ndarray) -> AlarmRate:
    """Return alarms per hour if an alarm ends its operation, as `FalseAlarmTarget` defines.

    `alarm`: bool [operations], independent. `hours`: [operations], length of the whole operation.
    The rate is the number of alarms divided by the hours of operations without an alarm. This is p
    / (1 - p) / m, for the share p of operations with an alarm and the mean length m of operations
    without an alarm. The formula also gives both ends of the interval, from the exact interval of
    p. The rate is infinite if all operations had an alarm.
    """
    count, hours_without_alarm = int(alarm.sum()), hours[~alarm]
    if not hours.sum() > 0:
        return AlarmRate(count)
    share = clopper_pearson(count, len(alarm))
    # If every operation had an alarm, the longest operation takes the place of the mean.
    has_mean = hours_without_alarm.any()
    mean = float(hours_without_alarm.mean() if has_mean else hours.max())
    low, high = (p / (1.0 - p) / mean if p < 1.0 else math.inf for p in (share.low, share.high))
    total = float(hours_without_alarm.sum())
    return AlarmRate(count, total, count / total if total else math.inf, low, high)


def rate_bounds(count: ArrayLike, hours: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends of exact 95 % intervals of Poisson rates. `hours` must be above 0."""
    from statsmodels.stats.rates import confint_poisson  # slow to import

    counts, times = np.broadcast_arrays(np.asarray(count), np.asarray(hours, float))
    low, high = confint_poisson(counts, times, "exact-c", ALPHA)
    # confint_poisson returns numbers for a single rate.
    return np.reshape(low, counts.shape), np.reshape(high, counts.shape)
