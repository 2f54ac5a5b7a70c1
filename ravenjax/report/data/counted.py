"""Delays that were counted: the estimates of `stats.latency` from how many runs have each delay.

Times are whole milliseconds, so the runs of a table, however many, have a few thousand different
delays. The formulas are those of `scipy.stats.ecdf`, which takes no counts.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ravenjax.stats.intervals import alpha_of, wilson
from ravenjax.stats.latency import Incidence, Lead


class Delays(NamedTuple):
    """Delays of runs, arrays [m]: `count` runs had the event after `time` where `came`, else
    were watched so long.
    """

    time: np.ndarray  # ms; alarm minus harm: negative before
    came: np.ndarray  # bool
    count: np.ndarray  # runs

    @property
    def n(self) -> int:
        """Runs in all."""
        return int(self.count.sum())


NONE = Delays(np.zeros(0, int), np.zeros(0, bool), np.zeros(0, int))
"""Of no runs."""


def incidence(delays: Delays, confidence: float = 0.95) -> Incidence:
    """As `stats.latency.incidence`."""
    return _curve(delays, 0.0, confidence)


def lead(lags: Delays, confidence: float = 0.95) -> Lead:
    """As `stats.latency.lead_time`; `lags`: alarm minus harm of the harmed runs, without an
    alarm the end minus it.
    """
    start = float(lags.time.min(initial=0))
    before = int(lags.count[lags.came & (lags.time < 0)].sum())
    curve = _curve(lags, start, confidence)
    return Lead(curve, wilson(before, lags.n, confidence), int(lags.count[lags.came].sum()), lags.n)


def median(values: np.ndarray, count: np.ndarray) -> float:
    """Median of values [m] of which there are so many; NaN of none."""
    if not count.sum():
        return float("nan")
    order = np.argsort(values)
    last = np.cumsum(count[order])
    middle = (last[-1] - 1) // 2, last[-1] // 2
    return float(np.mean(values[order][np.searchsorted(last, middle, side="right")]))


def _curve(delays: Delays, start: float, confidence: float) -> Incidence:
    from scipy.special import ndtri

    alpha = alpha_of(confidence)
    events = int(delays.count[delays.came].sum())
    if not events:
        zero = np.zeros(1)
        return Incidence(np.full(1, start), zero, zero, zero, 0, delays.n)
    time, place = np.unique(delays.time.astype(float), return_inverse=True)
    at = np.bincount(place, delays.count)
    died = np.bincount(place, delays.count * delays.came)
    risk = delays.n - np.cumsum(at) + at
    with np.errstate(divide="ignore", invalid="ignore"):
        censored = events < delays.n
        staying = np.cumprod((risk - died) / risk) if censored else 1 - np.cumsum(died) / delays.n
        fraction = 1 - staying if censored else np.cumsum(died) / delays.n
        error = np.sqrt(np.cumsum(died / (risk * (risk - died))) / np.log(staying) ** 2)
        middle, half = np.log(-np.log(staying)), ndtri(1 - alpha / 2) * error
        low, high = 1 - np.exp(-np.exp(middle - half)), 1 - np.exp(-np.exp(middle + half))
    # no value before the first event and after the last: the neighbour's or the trivial bound
    # stands
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
