"""False alarms per hour, and the threshold that keeps them rare.

A percentile of samples says nothing about how often a detector disturbs: alarms come in bursts. So a run counts once,
by its highest score, and the rate is per hour of fault-free operation (until the alarm where it ends the run).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.alarms.roc import alarms
from ravenjax.stats.intervals import alpha_of


class AlarmRate(NamedTuple):
    """count alarms in so many hours; per_hour with its exact Poisson interval, NaN where hours is 0."""

    count: int
    hours: float
    per_hour: float
    low: float
    high: float


class Threshold(NamedTuple):
    """A threshold (unit of the score), and the false alarms that it gave on the runs it was chosen on."""

    threshold: float
    false_alarms: AlarmRate


def alarm_rate(count: int, hours: float, confidence: float = 0.95) -> AlarmRate:
    """Alarms per hour with the exact interval of a Poisson rate (Garwood 1936), for `count` independent alarms.

    ValueError where count or hours is negative or there are alarms in no time.
    """
    if count < 0 or not hours >= 0 or (count and not hours):
        raise ValueError(f"alarm_rate needs count >= 0 in hours > 0, got {count} in {hours} h")
    if not hours:
        return AlarmRate(0, 0.0, math.nan, math.nan, math.nan)
    low, high = rate_bounds(count, hours, confidence)
    return AlarmRate(int(count), float(hours), count / hours, float(low), float(high))


def rate_bounds(count: ArrayLike, hours: ArrayLike, confidence: float = 0.95) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the exact intervals of Poisson rates, arrays of one shape; hours above 0. ValueError as `alpha_of`."""
    from statsmodels.stats.rates import confint_poisson  # slow to import

    counts, times = np.broadcast_arrays(np.asarray(count), np.asarray(hours, float))
    low, high = confint_poisson(counts, times, "exact-c", alpha_of(confidence))
    return np.reshape(low, counts.shape), np.reshape(high, counts.shape)  # of one rate it makes numbers


def threshold_for_rate(
    score: ArrayLike, hours: float, per_hour: float, confidence: float = 0.95, *, assured: bool = False
) -> Threshold:
    """Lowest threshold with at most `per_hour` false alarms, from the highest score [runs] of each fault-free run.

    score in any unit (-inf: never alarms, +inf: always), together `hours` hours. The threshold lies just above the
    highest score that it must let pass; equal scores pass or alarm together. Without `assured` the rate seen on these
    runs is at most per_hour, and the true rate is above it about half the time. With it the true rate is at most
    per_hour with this confidence: the order statistic of a Poisson process, so it holds though the threshold was
    chosen on the same runs. ValueError where a score is NaN, hours or per_hour is not positive, no threshold will do
    (too many runs score +inf), or the hours are too few for any assurance: it says how many are needed.
    """
    from scipy.stats import poisson

    values = np.asarray(score, float)
    if np.isnan(values).any():
        raise ValueError(f"{int(np.isnan(values).sum())} scores are NaN; a run that can never alarm scores -inf")
    if not (hours > 0 and per_hour > 0):
        raise ValueError(f"threshold_for_rate needs hours > 0 and per_hour > 0, got {hours} and {per_hour}")
    expected = hours * per_hour
    allowed = math.floor(expected * (1 + 1e-12))
    if assured:
        # the most alarms that a true rate of per_hour would show at most with chance 1 - confidence
        allowed = int(poisson.ppf(alpha_of(confidence), expected))
        allowed -= poisson.cdf(allowed, expected) > alpha_of(confidence)
        if allowed < 0:
            needed = -math.log(alpha_of(confidence)) / per_hour
            raise ValueError(
                f"{hours:g} fault-free hours cannot assure {per_hour:g} alarms per hour at {confidence:g} even without "
                f"an alarm: run at least {needed:.3g} h, or ask for a higher rate"
            )
    falling = np.sort(values)[::-1]
    if allowed >= len(falling):
        threshold = -math.inf
    elif falling[allowed] == math.inf:
        raise ValueError(
            f"{int((falling == math.inf).sum())} fault-free runs alarm at any threshold (+inf), {allowed} may at "
            f"{per_hour:g} per hour in {hours:g} h"
        )
    else:
        threshold = float(np.nextafter(falling[allowed], math.inf))
    count = int(alarms(values, np.array([threshold]))[0])
    return Threshold(threshold, alarm_rate(count, hours, confidence))
