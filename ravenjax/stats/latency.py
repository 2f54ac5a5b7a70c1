"""Analyses delays to an event that may never happen, such as an alarm.

A run that ends without the event is censored, not dropped. Censoring is assumed to be
uninformative: a run that a stop ended early would have continued like the others.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate, Rate, wilson_interval


class Delays(NamedTuple):
    """Delays of runs, counted by delay; arrays [m].

    Delays are whole milliseconds, so m is at most a few thousand for any number of runs.
    """

    # Delay, in any unit. For lags: alarm minus harm, negative if the alarm was first.
    time: np.ndarray
    # bool: the event happened after `time`. Else the runs were observed for `time` without it.
    came: np.ndarray
    count: np.ndarray  # number of runs

    @property
    def n(self) -> int:
        """Return the number of runs."""
        return int(self.count.sum())


NONE = Delays(np.zeros(0, int), np.zeros(0, bool), np.zeros(0, int))
"""The delays of no runs."""


class Incidence(NamedTuple):
    """Kaplan-Meier estimate of the fraction of runs with the event until `time`, with a band."""

    # In the unit of the delays, increasing, from 0 (for lags: from the smallest lag).
    time: np.ndarray
    fraction: np.ndarray
    low: np.ndarray
    high: np.ndarray
    events: int
    n: int

    def quantile(self, fraction: float) -> float:
        """Return the time until which `fraction` of the runs had the event; NaN if never."""
        return _first(self.time, self.fraction, fraction)

    def quantile_interval(self, fraction: float) -> Estimate:
        """Return `quantile` with its interval: the times whose band contains `fraction`.

        The method is from Brookmeyer, Crowley, Biometrics 38, 1982. A bound is NaN if there are too
        few runs, or if they end too early.
        """
        return Estimate(
            self.quantile(fraction),
            *(_first(self.time, edge, fraction) for edge in (self.high, self.low)),
        )


class Lead(NamedTuple):
    """Lead time of an alarm before the harm, over all harmful runs.

    lag: incidence of the alarm over the time of the alarm minus that of the harm (negative: before
    the harm). Runs without an alarm are censored at their end. before: rate of harmful runs with an
    alarm before the harm.
    """

    lag: Incidence
    before: Rate

    def quantile(self, fraction: float) -> Estimate:
        """Return the lead time that this fraction of the harmful runs had or exceeded, with its
        interval. It is negative for an alarm after the harm.

        The result is NaN if fewer runs had an alarm. A bound is NaN if it is unknown.
        """
        value, low, high = self.lag.quantile_interval(fraction)
        return Estimate(-value, -high, -low)


def incidence_curve(delays: Delays) -> Incidence:
    """Return the incidence over time. Its 95 % band is pointwise (Greenwood, log(-log))."""
    return _curve(delays, 0.0)


def lead_time(lags: Delays) -> Lead:
    """Return the lead time of an alarm before the harm.

    `lags`: alarm minus harm of all harmful runs. Runs without an alarm are censored, with the end
    of the run minus the harm. So a detector cannot look better because it misses faults.
    """
    start = float(lags.time.min(initial=0))
    before = int(lags.count[lags.came & (lags.time < 0)].sum())
    return Lead(_curve(lags, start), wilson_interval(before, lags.n))


def delay_quantile(
    delay: ArrayLike, happened: ArrayLike, fraction: float, among: Units
) -> Estimate:
    """Return the time until which `fraction` of the runs had the event, with an interval by
    resampling units.

    delay: time to the event or to the end of the run, perhaps negative. happened: bool, the event
    happened. A bound is NaN if too few resamples reach the fraction, or if there are too few units.
    """
    times, came = np.asarray(delay, float), np.asarray(happened).astype(bool)
    if not len(times):
        return Estimate()
    # At equal times, runs with the event come first.
    order = np.lexsort((~came, times))

    def first(weight: np.ndarray) -> np.ndarray:
        reached = 1 - _staying(weight, came, order) >= fraction - 1e-9
        return np.where(reached.any(axis=1), times[order][reached.argmax(axis=1)], np.nan)

    return units.statistic_band(first, among)


def _curve(delays: Delays, start: float) -> Incidence:
    # Returns the share of runs with the event over time, with its band. The formulas are those of
    # scipy.stats.ecdf, which cannot use counts of equal delays.
    from scipy.special import ndtri

    events = int(delays.count[delays.came].sum())
    if not events:
        zero = np.zeros(1)
        return Incidence(np.full(1, start), zero, zero, zero, 0, delays.n)
    time, index = np.unique(delays.time.astype(float), return_inverse=True)
    # Numbers of runs at each time: observed until then, with the event, and under observation.
    ending = np.bincount(index, delays.count)
    died = np.bincount(index, delays.count * delays.came)
    risk = delays.n - np.cumsum(ending) + ending
    with np.errstate(divide="ignore", invalid="ignore"):
        censored = events < delays.n
        staying = np.cumprod((risk - died) / risk) if censored else 1 - np.cumsum(died) / delays.n
        fraction = 1 - staying if censored else np.cumsum(died) / delays.n
        error = np.sqrt(np.cumsum(died / (risk * (risk - died))) / np.log(staying) ** 2)
        middle, half = np.log(-np.log(staying)), ndtri(0.975) * error
        low, high = 1 - np.exp(-np.exp(middle - half)), 1 - np.exp(-np.exp(middle + half))
    # The formulas give NaN before the first and after the last event. There the bound is that of
    # the neighbour, or 0 or 1.
    low = np.maximum.accumulate(np.nan_to_num(low, nan=0.0))
    high = np.minimum.accumulate(np.nan_to_num(high, nan=1.0)[::-1])[::-1]
    return Incidence(
        np.concatenate([[start], time]),
        np.concatenate([[0.0], fraction]),
        np.concatenate([[0.0], np.minimum(low, fraction)]),
        np.concatenate([[0.0], np.maximum(high, fraction)]),
        events,
        delays.n,
    )


def _staying(weight: np.ndarray, came: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Return the Kaplan-Meier share without the event after each run, in this order; [b, n].

    weight: weights of runs in b resamples [b, n].
    """
    mine = weight[:, order]
    at_risk = mine[:, ::-1].cumsum(axis=1)[:, ::-1]
    lost = np.divide(mine * came[order], at_risk, out=np.zeros_like(mine), where=at_risk > 1e-9)
    return np.cumprod(1 - lost, axis=1)


def _first(time: np.ndarray, fraction: np.ndarray, wanted: float) -> float:
    # The tolerance allows for rounding, so that 11 of 22 are a half.
    reached = np.flatnonzero(fraction >= wanted - 1e-12)
    return float(time[reached[0]]) if len(reached) else float("nan")
