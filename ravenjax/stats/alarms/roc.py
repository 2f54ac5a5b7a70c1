"""Measures by ROC and precision-recall curves how a score separates harmful and harmless runs.

A run has an alarm at a threshold if its score is at least the threshold. A score of -inf never
gives an alarm. Labels are bool: True for a run that should have an alarm.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.intervals import Estimate
from ravenjax.stats.units import band_ends, group_units

GRID = np.linspace(0.0, 1.0, 101)


class CurveBand(NamedTuple):
    """A curve on a common grid with its bootstrap band, and the area under it with its band."""

    grid: np.ndarray  # false-positive rates (fpr), or recalls
    curve: Estimate  # true-positive rates (tpr), or precisions, arrays of the grid's length
    area: Estimate  # AUC or average precision


def curve_bands(
    score: ArrayLike,
    positive: ArrayLike,
    cluster: ArrayLike,
    *,
    grid: np.ndarray = GRID,
    resamples: int = 1000,
    seed: int = 0,
) -> tuple[CurveBand, CurveBand]:
    """Return the ROC curve and the precision-recall curve, with 95 % bands that resample clusters.

    The ROC curve is the tpr at each fpr of `grid`, and its area is the AUC. The other curve is the
    precision at the highest threshold whose recall reaches each value of `grid` above the first,
    which is 0. Its area is the average precision. `cluster`: label of each run's cluster [n];
    np.arange(n) if runs are independent. The bands are pointwise. Raise ValueError if a score is
    NaN or a label is missing. scikit-learn sorts for each resample and is about 5 times slower.
    """
    values, truth = np.asarray(score, float), np.asarray(positive, bool)
    if np.isnan(values).any():
        raise ValueError(
            f"{int(np.isnan(values).sum())} scores are NaN; use -inf for a run that has no alarm"
        )
    order = np.argsort(-values, kind="stable")
    falling = values[order]
    # Index of the last run of each score. Counts up to this run include all runs of the score.
    last_of_score = np.flatnonzero(np.append(falling[1:] != falling[:-1], True))
    recalls = grid[1:]

    def curves(hits: np.ndarray, false_alarms: np.ndarray) -> np.ndarray:
        # Returns [ROC curve at `grid`, its area, precisions at `recalls`, average precision], from
        # the counts at each threshold, the highest first. The ROC curve begins at (0, 0).
        tpr, fpr = (np.insert(count, 0, 0.0) / count[-1] for count in (hits, false_alarms))
        roc = np.append(np.interp(grid, fpr, tpr), np.trapezoid(tpr, fpr))
        recall, precision = hits / hits[-1], hits / (hits + false_alarms)
        # The tolerance allows for rounding.
        reached = np.searchsorted(recall, recalls * (1 - 1e-12))
        gain = np.diff(recall, prepend=0.0)
        average = gain[gain > 0] @ precision[gain > 0]
        return np.concatenate([roc, precision[reached], [average]])

    def statistic(weight: np.ndarray) -> np.ndarray:
        # Returns the curves for each resample. weight: of each run in each resample [b, runs].
        ordered = weight[:, order]
        hits = np.cumsum(ordered * truth[order], axis=1)[:, last_of_score]
        false_alarms = np.cumsum(ordered * ~truth[order], axis=1)[:, last_of_score]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.stack([curves(*counts) for counts in zip(hits, false_alarms, strict=True)])

    (value,) = statistic(np.ones((1, len(values))))
    low, high = band_ends(group_units(cluster).resample_statistic(statistic, resamples, seed))

    def band(x: np.ndarray, first: int) -> CurveBand:
        # The area comes after the curve's points.
        end = first + len(x)
        curve = Estimate(value[first:end], low[first:end], high[first:end])
        return CurveBand(x, curve, Estimate(float(value[end]), float(low[end]), float(high[end])))

    return band(grid, 0), band(recalls, len(grid) + 1)
