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

    def curve(hits: np.ndarray, misses: np.ndarray) -> np.ndarray:
        tpr, fpr = (np.insert(part, 0, 0.0) / part[-1] for part in (hits, misses))
        return np.append(np.interp(grid, fpr, tpr), np.trapezoid(tpr, fpr))

    return _band(score, positive, cluster, curve, grid, resamples, seed)


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

    The bands are those of `roc_band`.
    """

    def curve(hits: np.ndarray, misses: np.ndarray) -> np.ndarray:
        recall, precision = hits / hits[-1], hits / (hits + misses)
        reached = np.searchsorted(recall, grid * (1 - 1e-12))
        gained = np.diff(recall, prepend=0.0)
        return np.append(precision[reached], gained[gained > 0] @ precision[gained > 0])

    return _band(score, positive, cluster, curve, grid, resamples)


def _band(
    score: ArrayLike,
    positive: ArrayLike,
    cluster: ArrayLike,
    curve: Callable[[np.ndarray, np.ndarray], np.ndarray],
    grid: np.ndarray,
    resamples: int,
    seed: int = 0,
) -> CurveBand:
    """Return the band of `curve`, by a bootstrap over clusters.

    `curve`: maps hits and misses [thresholds], the numbers of positives and negatives with at least
    each score, to values. Scores fall. scikit-learn would sort for each resample, which is about 5
    times slower.
    """
    values, truth = np.asarray(score, float), np.asarray(positive, bool)
    if np.isnan(values).any():
        raise ValueError(
            f"{int(np.isnan(values).sum())} scores are NaN; use -inf for a run that has no alarm"
        )
    order = np.argsort(-values, kind="stable")
    falling = values[order]
    # Keep the last of equal scores.
    last = np.flatnonzero(np.append(falling[1:] != falling[:-1], True))

    def statistic(weight: np.ndarray) -> np.ndarray:
        # Returns the curve for each row of resampling weights [draws, operations].
        ordered = weight[:, order]
        hits = np.cumsum(ordered * truth[order], axis=1)[:, last]
        misses = np.cumsum(ordered * ~truth[order], axis=1)[:, last]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.stack([curve(*pair) for pair in zip(hits, misses, strict=True)])

    (value,) = statistic(np.ones((1, len(values))))
    low, high = band_ends(group_units(cluster).resampled(statistic, resamples, seed))
    return CurveBand(
        grid,
        Estimate(value[:-1], low[:-1], high[:-1]),
        Estimate(*(float(part[-1]) for part in (value, low, high))),
    )
