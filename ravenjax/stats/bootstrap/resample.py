"""The bootstrap of anything that can be computed from chosen units: clusters, runs, base points
of a design.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

from ravenjax.stats.intervals import alpha_of

Kind = Literal["percentile", "BCa"]


class BootstrapBand(NamedTuple):
    """A statistic with its bootstrap interval: numbers, or arrays of one shape.

    `undefined`: resamples without a value (NaN), left out of the band; an array where value is one.
    """

    value: Any
    low: Any
    high: Any
    units: int  # resampled: clusters, runs
    undefined: Any


def bootstrap(
    units: int,
    statistic: Callable[[np.ndarray], np.ndarray],
    confidence: float = 0.95,
    *,
    resamples: int = 1000,
    seed: int = 0,
    kind: Kind = "percentile",
    batch: int = 100,
) -> BootstrapBand:
    """Band of a statistic of `units` exchangeable units by scipy.stats.bootstrap.

    statistic: index of the chosen units [b, m] -> values [b, ...], one for each row; at most
    `batch` rows at a time, which bounds memory and does not change the result. BCa (Efron 1987)
    corrects bias and skew at the price of `units` more evaluations, and is NaN where it cannot be
    computed. Fewer than some 20 units give too narrow a band. The same seed gives the same band.
    ValueError with fewer than 2 units.
    """
    from scipy.stats import DegenerateDataWarning
    from scipy.stats import bootstrap as resampled

    alpha = alpha_of(confidence)
    if units < 2:
        raise ValueError(f"a bootstrap needs at least 2 independent units, got {units}")

    def last(index: np.ndarray, axis: int = -1) -> np.ndarray:
        values = np.moveaxis(np.asarray(statistic(np.atleast_2d(index)), float), 0, -1)
        return values if index.ndim > 1 else values[..., 0]

    with warnings.catch_warnings(), np.errstate(invalid="ignore", divide="ignore"):
        warnings.simplefilter("ignore", DegenerateDataWarning)  # NaN tells it
        result = resampled(
            (np.arange(units),),
            last,
            n_resamples=resamples,
            batch=min(batch, resamples),
            vectorized=True,
            confidence_level=confidence,
            method=kind,
            rng=np.random.default_rng(seed),
        )
    samples = result.bootstrap_distribution
    undefined = np.isnan(samples).sum(axis=-1)
    if kind == "BCa":
        low, high = result.confidence_interval
    else:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # nothing but NaN: NaN
            low, high = np.nanquantile(samples, [alpha / 2, 1 - alpha / 2], axis=-1)
    value = last(np.arange(units))
    still = np.ptp(samples, axis=-1) == 0  # every resample alike: BCa has no spread to correct
    low, high = (np.where(still, samples[..., 0], bound) for bound in (low, high))
    return BootstrapBand(value[()], low[()], high[()], units, undefined[()])
