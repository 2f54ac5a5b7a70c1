"""Delays to an event that may never come: a run that ends without it is censored, not dropped.

Censoring is taken as uninformative: a run that a stop ended early would have gone on like the
others.
"""

from __future__ import annotations

import warnings
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.intervals import Estimate, Rate, alpha_of, wilson


class Incidence(NamedTuple):
    """Kaplan-Meier estimate of the fraction of runs in which the event came by `time`, with its
    confidence band.
    """

    time: np.ndarray  # as given, increasing, from 0 (a lead time: from the least)
    fraction: np.ndarray
    low: np.ndarray
    high: np.ndarray
    events: int
    n: int

    def quantile(self, fraction: float) -> float:
        """First time by which `fraction` of the runs had the event; NaN where that is never
        reached.
        """
        return _first(self.time, self.fraction, fraction)

    def quantile_interval(self, fraction: float) -> Estimate:
        """`quantile` with its interval: the times whose band holds `fraction`.

        Brookmeyer, Crowley, Biometrics 38, 1982. A bound is NaN where the runs are too few or end
        too early for it.
        """
        return Estimate(
            self.quantile(fraction),
            *(_first(self.time, edge, fraction) for edge in (self.high, self.low)),
        )


class Lead(NamedTuple):
    """How long before the harm the alarm came, over all harmed runs.

    lag: incidence of the alarm over alarm minus harm (negative: before the harm), runs without an
    alarm censored where their observation ended. before: rate of harmed runs whose alarm came
    strictly before the harm. alarmed: in how many it came at all.
    """

    lag: Incidence
    before: Rate
    alarmed: int
    n: int

    def quantile(self, fraction: float) -> Estimate:
        """Lead that this fraction of the harmed runs had or exceeded, with its interval; negative:
        after the harm.

        NaN where so many never had an alarm while they were watched; a bound is NaN where it is not
        known.
        """
        value, low, high = self.lag.quantile_interval(fraction)
        return Estimate(-value, -high, -low)


class LogRank(NamedTuple):
    """Log-rank test that two groups have the same law of delay; statistic is positive where the
    first's events come later. NaN where no event came."""

    statistic: float
    p: float


def incidence(delay: ArrayLike, happened: ArrayLike, confidence: float = 0.95) -> Incidence:
    """Incidence over time of an event: `delay` [n] to it where `happened` (bool [n]), else to the
    end of observation.

    Any unit of time. The band is pointwise, by Greenwood's variance of log(-log). ValueError where
    a delay is negative or not a number.
    """
    times, came = _delays(delay, happened, "incidence")
    return _curve(times, came, 0.0, confidence)


def quantile(
    delay: ArrayLike, happened: ArrayLike, fraction: float, among: Units, confidence: float = 0.95
) -> Estimate:
    """Time by which `fraction` of the runs had the event, as `Incidence.quantile`, its interval by
    resampling units.

    Runs as for `incidence`, but that times may be negative, as lags are. A bound is NaN where
    resamples reach the fraction too rarely to tell it, or where there are too few units.
    """
    times, came = np.asarray(delay, float), np.asarray(happened).astype(bool)
    if not len(times):
        return Estimate(np.nan, np.nan, np.nan)
    order = _order(times, came)

    def first(weight: np.ndarray) -> np.ndarray:
        reached = 1 - _staying(weight, came, order) >= fraction - 1e-9
        return np.where(reached.any(axis=1), times[order][reached.argmax(axis=1)], np.nan)

    return units.statistic(first, among, confidence)


def mean_within(
    delay: ArrayLike, happened: ArrayLike, horizon: float, among: Units, confidence: float = 0.95
) -> Estimate:
    """Mean of the delay where a longer one counts as `horizon`: the area under the curve of runs
    still without event (Klein, Moeschberger, Survival Analysis, 2003, 4.5). Its interval is by
    resampling units.

    Unit of the delay. NaN where n is 0. ValueError as `incidence`, or where the horizon
    lies beyond the last observation of runs still without event: nothing is known there.
    """
    times, came = _delays(delay, happened, "mean_within")
    if not len(times):
        return Estimate(np.nan, np.nan, np.nan)
    if times.max() < horizon and not came[times == times.max()].all():
        raise ValueError(
            f"mean_within: the horizon {horizon:g} lies beyond the last observation,"
            f" {times.max():g}, of runs without event; take that or less"
        )
    order = _order(times, came)
    ends = np.minimum(times[order], horizon)
    steps = np.diff(ends, append=horizon)

    def area(weight: np.ndarray) -> np.ndarray:
        return ends[0] + _staying(weight, came, order) @ steps

    return units.statistic(area, among, confidence)


def lead_time(
    alarm: ArrayLike, harm: ArrayLike, end: ArrayLike | float, confidence: float = 0.95
) -> Lead:
    """Lead of the alarm over the harm: times [n] of both, NaN where one never came, in any unit;
    `end` [n] or one number is when the observation of the run ended.

    Runs without harm have no lead and are left out (Lead.n counts the rest); an alarm that never
    came is censored at the end, so a detector cannot gain by missing. ValueError where a time
    lies after the end, or the end is not a number.
    """
    alarmed, harmed = np.asarray(alarm, float), np.asarray(harm, float)
    ended = np.broadcast_to(np.asarray(end, float), alarmed.shape)
    if not np.isfinite(ended).all() or (alarmed > ended).any() or (harmed > ended).any():
        raise ValueError(
            "lead_time: each run needs a finite end, and no alarm or harm comes after it"
        )
    harmful = ~np.isnan(harmed)
    came = ~np.isnan(alarmed[harmful])
    lag = np.where(came, alarmed[harmful], ended[harmful]) - harmed[harmful]
    curve = _curve(lag, came, lag.min(initial=0.0), confidence)
    before = wilson(int((came & (lag < 0)).sum()), len(lag), confidence)
    return Lead(curve, before, int(came.sum()), len(lag))


def log_rank(
    first: ArrayLike, first_happened: ArrayLike, second: ArrayLike, second_happened: ArrayLike
) -> LogRank:
    """Log-rank test (Mantel 1966) of two groups' delays [n1], [n2] with `happened` bool as in
    `incidence`.
    """
    from scipy.stats import CensoredData, logrank

    groups = [
        _delays(*group, "log_rank")
        for group in ((first, first_happened), (second, second_happened))
    ]
    if not any(came.any() for _, came in groups) or not all(len(times) for times, _ in groups):
        return LogRank(float("nan"), float("nan"))
    one, two = (CensoredData(uncensored=times[came], right=times[~came]) for times, came in groups)
    with np.errstate(invalid="ignore", divide="ignore"):
        test: Any = logrank(one, two)
    return LogRank(-float(test.statistic), float(test.pvalue))


def _curve(times: np.ndarray, came: np.ndarray, start: float, confidence: float) -> Incidence:
    from scipy.stats import CensoredData, ecdf

    alpha_of(confidence)
    if not came.any():
        zero = np.zeros(1)
        return Incidence(np.full(1, start), zero, zero, zero, 0, len(times))
    result = ecdf(CensoredData(uncensored=times[came], right=times[~came])).cdf
    with warnings.catch_warnings():
        # no value before the first event and after the last: the neighbour's or the trivial bound
        # stands
        warnings.simplefilter("ignore", RuntimeWarning)
        band = result.confidence_interval(confidence, method="log-log")
    low = np.maximum.accumulate(np.nan_to_num(band.low.probabilities, nan=0.0))
    high = np.minimum.accumulate(np.nan_to_num(band.high.probabilities, nan=1.0)[::-1])[::-1]
    time, fraction = result.quantiles, result.probabilities
    return Incidence(
        np.concatenate([[start], time]),
        np.concatenate([[0.0], fraction]),
        np.concatenate([[0.0], np.minimum(low, fraction)]),
        np.concatenate([[0.0], np.maximum(high, fraction)]),
        int(came.sum()),
        len(times),
    )


def _order(times: np.ndarray, came: np.ndarray) -> np.ndarray:
    """Places [n] by rising time, of runs at one time those with the event first."""
    return np.lexsort((~came, times))


def _staying(weight: np.ndarray, came: np.ndarray, order: np.ndarray) -> np.ndarray:
    """Kaplan-Meier share still without event after each run of `order`, of weighted runs [b, n]:
    [b, n].
    """
    mine = weight[:, order]
    at_risk = mine[:, ::-1].cumsum(axis=1)[:, ::-1]
    lost = np.divide(mine * came[order], at_risk, out=np.zeros_like(mine), where=at_risk > 1e-9)
    return np.cumprod(1 - lost, axis=1)


def _delays(delay: ArrayLike, happened: ArrayLike, caller: str) -> tuple[np.ndarray, np.ndarray]:
    times, came = np.asarray(delay, float), np.asarray(happened).astype(bool)
    if not (times >= 0).all():
        raise ValueError(f"{caller}: a delay is never negative, got {times[~(times >= 0)][0]}")
    return times, came


def _first(time: np.ndarray, fraction: np.ndarray, wanted: float) -> float:
    reached = np.flatnonzero(
        fraction >= wanted - 1e-12
    )  # 11 of 22 are a half, whatever a product of factors rounds to
    return float(time[reached[0]]) if len(reached) else float("nan")
