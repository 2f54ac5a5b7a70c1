"""Measures how well a score separates harmful from harmless runs, by ROC and precision-recall
curves.

A run has an alarm at a threshold if its score is at least the threshold. A score of -inf never
gives an alarm. Labels are bool: True for a run that should have an alarm.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.bootstrap.units import band_ends, group_units
from ravenjax.stats.intervals import Estimate

GRID = np.linspace(0.0, 1.0, 101)


class CurveBand(NamedTuple):
    """A curve on a common grid with its bootstrap band, and the area under it with its band."""

    grid: np.ndarray  # false-positive rates (fpr), or recalls
    curve: Estimate  # true-positive rates (tpr), or precisions, arrays of the grid's length
    area: Estimate  # AUC or average precision


def roc_band(
    score: ArrayLike,
    positive: ArrayLike,
    cluster: ArrayLike,
    *,
    grid: np.ndarray = GRID,
    resamples: int = 1000,
    seed: int = 0,
) -> CurveBand:
    """Return tpr at each fpr of `grid`, and AUC, with 95 % bands that resample clusters.

    `cluster`: label of each run's cluster [n]; np.arange(n) if runs are independent. The bands are
    pointwise. Raise ValueError if a score is NaN or a label is missing.
    """

    def curve(hits: np.ndarray, false_alarms: np.ndarray) -> np.ndarray:
        # The curve begins at 0, above the highest score.
        tpr, fpr = (np.insert(count, 0, 0.0) / count[-1] for count in (hits, false_alarms))
        return np.append(np.interp(grid, fpr, tpr), np.trapezoid(tpr, fpr))

    return _curve_band(score, positive, cluster, curve, grid, resamples=resamples, seed=seed)


def precision_recall_band(
    score: ArrayLike,
    positive: ArrayLike,
    cluster: ArrayLike,
    *,
    grid: np.ndarray = GRID[1:],
    resamples: int,
) -> CurveBand:
    """Return the precision at the highest threshold whose recall reaches each value of `grid`
    (above 0), and average precision.

    The bands and the other arguments are as in `roc_band`.
    """

    def curve(hits: np.ndarray, false_alarms: np.ndarray) -> np.ndarray:
        recall, precision = hits / hits[-1], hits / (hits + false_alarms)
        # The tolerance allows for rounding.
        reached = np.searchsorted(recall, grid * (1 - 1e-12))
        gain = np.diff(recall, prepend=0.0)
        return np.append(precision[reached], gain[gain > 0] @ precision[gain > 0])

    return _curve_band(score, positive, cluster, curve, grid, resamples=resamples)


def _curve_band(
    score: ArrayLike,
    positive: ArrayLike,
    cluster: ArrayLike,
    curve: Callable[[np.ndarray, np.ndarray], np.ndarray],
    grid: np.ndarray,
    *,
    resamples: int,
    seed: int = 0,
) -> CurveBand:
    """Return the values of `curve` at the points of `grid` and the area under the curve, with their
    bands, by a bootstrap over clusters.

    `curve`: maps the numbers of hits and false alarms at each threshold, which are the scores from
    the highest to the lowest, to these values and the area. scikit-learn would sort for each
    resample, which is about 5 times slower.
    """
    values, truth = np.asarray(score, float), np.asarray(positive, bool)
    if np.isnan(values).any():
        raise ValueError(
            f"{int(np.isnan(values).sum())} scores are NaN; use -inf for a run that has no alarm"
        )
    order = np.argsort(-values, kind="stable")
    falling = values[order]
    # Of equal scores, the last has the counts of all.
    last = np.flatnonzero(np.append(falling[1:] != falling[:-1], True))

    def statistic(weight: np.ndarray) -> np.ndarray:
        # Returns the curve for each resample. weight: of each run in each resample [b, runs].
        ordered = weight[:, order]
        hits = np.cumsum(ordered * truth[order], axis=1)[:, last]
        false_alarms = np.cumsum(ordered * ~truth[order], axis=1)[:, last]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.stack([curve(*counts) for counts in zip(hits, false_alarms, strict=True)])

    (value,) = statistic(np.ones((1, len(values))))
    low, high = band_ends(group_units(cluster).resample_statistic(statistic, resamples, seed))
    # The last value is the area.
    area = Estimate(float(value[-1]), float(low[-1]), float(high[-1]))
    return CurveBand(grid, Estimate(value[:-1], low[:-1], high[:-1]), area)
