"""Bootstraps statistics of independent units, optionally by stratum.

A *unit* was chosen independently of the other units, such as a kind of fault, an operator or a
recording. The rows of a unit resemble each other. The unit is the highest level that was sampled. A
*stratum* is a subset of the units that the design fixes. Each stratum is resampled separately.

The bootstrap is that of Rao and Wu (J. Am. Stat. Assoc. 83, 1988) with m = n - 1. It draws n - 1 of
the n units of a stratum with replacement, each with weight n / (n - 1). The variance of a mean is
then that of the sample with divisor n - 1. The plain bootstrap's variance is smaller by (n - 1) /
n, which matters for few units. A stratum of one unit contains no information on the variance
between units, so it is joined to other strata (collapsed strata: Wolter, Introduction to Variance
Estimation, 2007, 2.5).
"""

import warnings
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import ALPHA, Estimate, Rate, rate_bounds

MIN_UNITS = 5
"""Smallest number of units for an interval; fewer are too few to resample."""
ENOUGH_UNITS = 20
"""With fewer units an interval is somewhat too narrow, and a table states the number of units."""
RESAMPLES = 1000
_MAX_WEIGHTS = 2_000_000  # largest number of weights in a batch of resamples, 16 MB


class Units(NamedTuple):
    """The unit of each row, and the stratum of each unit."""

    unit: np.ndarray  # int [rows], from 0
    stratum: np.ndarray  # int [units], from 0

    @property
    def count(self) -> int:
        """Number of units."""
        return len(self.stratum)

    def where(self, rows: np.ndarray) -> "Units":
        """Return the units of a part of the rows: `rows` is bool [rows], or indices of rows."""
        present, unit = np.unique(self.unit[rows], return_inverse=True)
        return Units(unit, self.stratum[present])

    def weights(self, resamples: int = RESAMPLES, seed: int = 0) -> np.ndarray:
        """Return each unit's weight in each resample, [resamples, units]; mean 1 per stratum."""
        # Rao and Wu: n - 1 draws of the n units of a stratum, each draw with weight n / (n - 1).
        rng = np.random.default_rng(seed)
        weight = np.empty((resamples, self.count))
        for members in _units_by_stratum(self.stratum):
            n = len(members)
            counts = rng.multinomial(n - 1, np.full(n, 1 / n), resamples)
            weight[:, members] = counts * (n / (n - 1))
        return weight

    def resample_statistic(
        self, statistic: Callable[[np.ndarray], np.ndarray], resamples: int, seed: int
    ) -> np.ndarray:
        """Return the statistic of each resample, [resamples, ...]. statistic: maps weights of the
        rows in b resamples, [b, rows], to values [b, ...].
        """
        weight = self.weights(resamples, seed)
        # Each row gets the weight of its unit, for a batch of resamples at a time to limit memory.
        batch = max(1, _MAX_WEIGHTS // max(1, len(self.unit)))
        parts = [statistic(weight[i : i + batch, self.unit]) for i in range(0, resamples, batch)]
        return np.concatenate(parts)


def label_codes(label: ArrayLike) -> tuple[np.ndarray, int]:
    """Return each row's label as a number [n], and the number of different labels. Raise ValueError
    for a missing label.
    """
    import pandas as pd

    labels: Any = label if isinstance(label, pd.Series | pd.Categorical) else np.asarray(label)
    code, names = pd.factorize(labels)
    if (code < 0).any():
        raise ValueError(f"units: {int((code < 0).sum())} rows have no label (NaN)")
    return code, len(names)


def group_units(label: ArrayLike, stratum: ArrayLike | None = None) -> "Units":
    """Return the units of rows [n]: rows with the same label are one unit. `stratum`: labels [n] of
    strata; None: one stratum. Labels may have any type. Raise ValueError if a label is missing, or
    if a unit is in two strata.
    """
    unit, count = label_codes(label)
    if stratum is None:
        return Units(unit, np.zeros(count, int))
    row_stratum, _ = label_codes(stratum)
    unit_stratum = np.zeros(count, int)
    unit_stratum[unit] = row_stratum
    # If a row's stratum is not its unit's, another row of the unit has overwritten the unit's.
    if (unit_stratum[unit] != row_stratum).any():
        raise ValueError("units: each unit must be in one stratum, but a unit is in several")
    return Units(unit, unit_stratum)


def ratio_band(
    numerators: ArrayLike,
    denominators: ArrayLike,
    among: "Units",
    *,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> Estimate:
    """Return sum(numerators) / sum(denominators) over rows [n] with its percentile band. With
    `denominators` = 1 it is a mean. The band is NaN for fewer than MIN_UNITS units. If all units
    have the same ratio, the band has zero width; `rate_band` avoids this for shares.
    """
    # Sums of both columns over the rows of each unit, [2, units].
    columns = [np.broadcast_to(x, among.unit.shape) for x in (numerators, denominators)]
    sums = np.stack([np.bincount(among.unit, x, minlength=among.count) for x in columns])
    with np.errstate(invalid="ignore", divide="ignore"):
        total = sums.sum(axis=1)
        value = total[0] / total[1]
        if among.count < MIN_UNITS:
            return Estimate(value)
        numerator, denominator = sums @ among.weights(resamples, seed).T
        samples = numerator / denominator
    low, high = band_ends(np.where(np.isfinite(samples), samples, np.nan))
    return Estimate(float(value), float(low), float(high))


def rate_band(hit: ArrayLike, among: "Units", *, resamples: int = RESAMPLES, seed: int = 0) -> Rate:
    """Return the share of rows with `hit` (bool [n]), with the band of `ratio_band`. If all rows
    are equal, resamples are equal too. The band is then Wilson's interval, with the number of units
    as the number of trials. The share is NaN without rows.
    """
    hits = np.asarray(hit, bool)
    k, n = int(hits.sum()), len(hits)
    if not n:
        return Rate()
    if 0 < k < n:
        band = ratio_band(hits, 1.0, among, resamples=resamples, seed=seed)
        return Rate(k, n, k / n, float(band.low), float(band.high))
    if among.count < MIN_UNITS:
        return Rate(k, n, k / n)
    low, high = rate_bounds(np.array(k / n * among.count), np.array(among.count))
    return Rate(k, n, k / n, float(low), float(high))


def _units_by_stratum(stratum: np.ndarray) -> list[np.ndarray]:
    """Return the units of each stratum. Strata of one unit are merged with each other; if there is
    only one, it joins the smallest other stratum.
    """
    strata = [np.flatnonzero(stratum == number) for number in np.unique(stratum)]
    large_strata = sorted((members for members in strata if len(members) > 1), key=len)
    single_units = [members for members in strata if len(members) == 1]
    if not single_units:
        return large_strata
    merged = np.concatenate(single_units)
    if len(merged) > 1 or not large_strata:
        return [*large_strata, merged]
    return [np.concatenate([large_strata[0], merged]), *large_strata[1:]]


def bootstrap(
    units: int,
    statistic: Callable[[np.ndarray], np.ndarray],
    *,
    resamples: int = 1000,
    seed: int = 0,
    batch: int = 100,
) -> Estimate:
    """Return a statistic of `units` exchangeable units with its 95 % percentile band.

    `statistic`: maps indices of the units drawn in b resamples, [b, units], to values [b, ...].
    `batch`: largest b, which limits memory and does not change the result. With fewer than about 20
    units the band is too narrow. Resamples without a value (NaN) are left out. Raise ValueError for
    fewer than 2 units.
    """
    if units < 2:
        raise ValueError(f"a bootstrap needs at least 2 independent units, got {units}")
    rng = np.random.default_rng(seed)
    sizes = [min(batch, resamples - first) for first in range(0, resamples, batch)]
    with np.errstate(invalid="ignore", divide="ignore"):
        # The statistic of the sample itself: one "resample" that has each unit once.
        value = np.asarray(statistic(np.arange(units)[None]), float)[0]
        samples = np.concatenate(
            [np.asarray(statistic(rng.integers(units, size=(b, units))), float) for b in sizes]
        )
    low, high = band_ends(samples)
    return Estimate(value, low, high)


def band_ends(samples: np.ndarray) -> np.ndarray:
    """Return both ends [2, ...] of the central 95 % of samples [b, ...]. Samples that are NaN are
    left out; the ends are NaN if all are NaN.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nanquantile(samples, [ALPHA / 2, 1 - ALPHA / 2], axis=0)
