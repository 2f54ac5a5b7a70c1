"""Analyses delays to an event that may never happen, such as an alarm.

A run that ends without the event is censored, not dropped. Censoring is assumed to be
uninformative: a run that a stop ended early would have continued like the others.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats import units
from ravenjax.stats.intervals import Estimate, Rate, wilson_interval
from ravenjax.stats.units import Units


class Delays(NamedTuple):
    """Delays of runs. Runs with equal delays are counted together; arrays [m]. Delays are whole
    milliseconds, so m is at most a few thousand for any number of runs.
    """

    # Delay, in any unit. For lags: alarm minus harm, negative if the alarm was first.
    time: np.ndarray
    # bool: the event happened after `time`. Else the runs were observed for `time` without it.
    occurred: np.ndarray
    count: np.ndarray  # number of runs

    @property
    def n(self) -> int:
        """Number of runs."""
        return int(self.count.sum())


NO_DELAYS = Delays(np.zeros(0, int), np.zeros(0, bool), np.zeros(0, int))
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
        """Return the time until which `fraction` of the runs had the event; NaN if fewer had it."""
        return _time_of_fraction(self.time, self.fraction, fraction)

    def quantile_interval(self, fraction: float) -> Estimate:
        """Return `quantile` with its interval: the times at which the band of this curve contains
        `fraction` (Brookmeyer, Crowley, Biometrics 38, 1982). A bound is NaN if there are too few
        runs, or if they end too early.
        """
        # The upper end of the band reaches the fraction first.
        low = _time_of_fraction(self.time, self.high, fraction)
        high = _time_of_fraction(self.time, self.low, fraction)
        return Estimate(self.quantile(fraction), low, high)


def rate_before(lags: Delays) -> Rate:
    """Return the rate of harmful runs with an alarm before the harm. `lags`: alarm minus harm, thus
    negative if the alarm was first. All harmful runs are included: without an alarm, the lag is at
    least the end of the run minus the harm (censored). Missed faults lower the rate.
    """
    runs_before = lags.count[lags.occurred & (lags.time < 0)]
    return wilson_interval(int(runs_before.sum()), lags.n)


def delay_quantile(
    delay: ArrayLike, happened: ArrayLike, fraction: float, run_units: Units | None
) -> Estimate:
    """Return when `fraction` of the runs had the event, with an interval by resampling units.

    delay: time to the event or to the end of the run, perhaps negative [n]. happened: bool, the
    event happened [n]. run_units: the units of the runs; None: nothing was drawn. A bound is NaN if
    too few resamples reach the fraction, or for fewer than `units.MIN_UNITS` units.
    """
    times, occurred = np.asarray(delay, float), np.asarray(happened).astype(bool)
    if not len(times):
        return Estimate()
    # At equal times, runs with the event come first.
    order = np.lexsort((~occurred, times))

    def quantiles(weight: np.ndarray) -> np.ndarray:
        # Returns the time in each of b resamples, from the weights of the runs in it, [b, n]. The
        # tolerance allows for rounding.
        reached = 1 - _share_without_event(weight, occurred, order) >= fraction - 1e-9
        return np.where(reached.any(axis=1), times[order][reached.argmax(axis=1)], np.nan)

    value = float(quantiles(np.ones((1, len(times))))[0])
    if run_units is None or run_units.count < units.MIN_UNITS:
        return Estimate(value)
    # Resamples that never reach the fraction (NaN) are sorted last.
    samples = np.sort(run_units.resample_statistic(quantiles, units.RESAMPLES, 0))
    low, high = (float(samples[round(share * len(samples))]) for share in (0.025, 0.975))
    return Estimate(value, low, high)


def incidence_curve(delays: Delays) -> Incidence:
    """Return the incidence over time, with a pointwise 95 % band (Greenwood, log(-log)). Lead times
    of alarms before the harm are negated lags, see `Estimate.negated`.
    """
    # The formulas are as in scipy.stats.ecdf, which cannot use counts of equal delays.
    from scipy.special import ndtri

    events, start = int(delays.count[delays.occurred].sum()), float(delays.time.min(initial=0))
    if not events:
        zero = np.zeros(1)
        return Incidence(np.full(1, start), zero, zero, zero, 0, delays.n)
    time, index = np.unique(delays.time.astype(float), return_inverse=True)
    # Numbers of runs at each time: observed until then, with the event then, and under observation.
    ended = np.bincount(index, delays.count)
    had_event = np.bincount(index, delays.count * delays.occurred)
    at_risk = delays.n - np.cumsum(ended) + ended
    with np.errstate(divide="ignore", invalid="ignore"):
        # The estimate without censored runs. The product below would round this plain share.
        fraction = np.cumsum(had_event) / delays.n
        without_event = 1 - fraction
        if events < delays.n:
            without_event = np.cumprod((at_risk - had_event) / at_risk)
            fraction = 1 - without_event
        variance = np.cumsum(had_event / (at_risk * (at_risk - had_event)))
        error = np.sqrt(variance / np.log(without_event) ** 2)
        middle, half = np.log(-np.log(without_event)), ndtri(0.975) * error
        low, high = 1 - np.exp(-np.exp(middle - half)), 1 - np.exp(-np.exp(middle + half))
    # The formulas give NaN before the first and after the last event. Such a bound is replaced by
    # the neighbour's bound, or by 0 or 1.
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


def _share_without_event(weight: np.ndarray, occurred: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Return the Kaplan-Meier estimate of the share of runs without the event after the delay of
    each run, [b, n], with runs sorted by delay. weight: weights of runs in b resamples [b, n].
    occurred: bool [n]. order: indices that sort.
    """
    sorted_weight = weight[:, order]
    # Weight of the runs that were observed at least as long as each run, itself included.
    at_risk = sorted_weight[:, ::-1].cumsum(axis=1)[:, ::-1]
    share, events = np.zeros_like(at_risk), sorted_weight * occurred[order]
    np.divide(events, at_risk, out=share, where=at_risk > 1e-9)
    return np.cumprod(1 - share, axis=1)


def _time_of_fraction(time: np.ndarray, curve: np.ndarray, fraction: float) -> float:
    # Returns the first time at which the curve reaches the fraction; NaN if it does not. The
    # tolerance allows for rounding, so that 11 of 22 are a half.
    reached = np.flatnonzero(curve >= fraction - 1e-12)
    return float(time[reached[0]]) if len(reached) else float("nan")
