"""Delays to an event that may never come: a run that ends without it is censored, not dropped."""

from __future__ import annotations

import warnings
from typing import NamedTuple

import numpy as np
from scipy.stats import CensoredData, ecdf


class Incidence(NamedTuple):
    """Kaplan-Meier estimate of the fraction of runs in which the event came by `time`, with its confidence band."""

    time: np.ndarray  # as given, increasing, from 0
    fraction: np.ndarray
    low: np.ndarray
    high: np.ndarray
    events: int
    n: int

    def quantile(self, fraction: float) -> float:
        """First time by which `fraction` of the runs had the event; NaN where that is never reached."""
        reached = np.flatnonzero(self.fraction >= fraction)
        return float(self.time[reached[0]]) if len(reached) else float("nan")


def incidence(delay: np.ndarray, happened: np.ndarray, confidence: float = 0.95) -> Incidence:
    """Incidence over time of an event: `delay` to it where `happened`, else to the end of observation.

    ValueError where a delay is negative or not a number, or the lengths differ.
    """
    delay, happened = np.asarray(delay, float), np.asarray(happened, bool)
    if delay.shape != happened.shape or delay.ndim != 1:
        raise ValueError(
            f"incidence: delay {delay.shape} and happened {happened.shape} must be one-dimensional and equal"
        )
    if not (delay >= 0).all():
        raise ValueError(f"incidence: a delay is never negative, got {delay[~(delay >= 0)][0]}")
    if not happened.any():
        zero = np.zeros(1)
        return Incidence(zero, zero, zero, zero, 0, len(delay))
    result = ecdf(CensoredData(uncensored=delay[happened], right=delay[~happened])).cdf
    with (
        warnings.catch_warnings()
    ):  # no value before the first event and after the last: the neighbour's or the trivial bound stands
        warnings.simplefilter("ignore", RuntimeWarning)
        band = result.confidence_interval(confidence, method="log-log")
    low = np.maximum.accumulate(np.nan_to_num(band.low.probabilities, nan=0.0))
    high = np.minimum.accumulate(np.nan_to_num(band.high.probabilities, nan=1.0)[::-1])[::-1]
    time, fraction = result.quantiles, result.probabilities
    return Incidence(
        np.concatenate([[0.0], time]),
        np.concatenate([[0.0], fraction]),
        np.concatenate([[0.0], np.minimum(low, fraction)]),
        np.concatenate([[0.0], np.maximum(high, fraction)]),
        int(happened.sum()),
        len(delay),
    )
