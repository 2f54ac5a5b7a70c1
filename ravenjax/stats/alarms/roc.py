"""How well a score tells harmful runs from harmless ones: ROC, precision-recall, operating points.

A run alarms at a threshold where its score is at least the threshold; a score of -inf never alarms. Labels are bool,
True for a run that should alarm. Curves and areas are scikit-learn's.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ravenjax.stats.bootstrap.clusters import cluster_bootstrap
from ravenjax.stats.bootstrap.resample import BootstrapBand
from ravenjax.stats.intervals import Rate, rates

GRID = np.linspace(0.0, 1.0, 101)


class Roc(NamedTuple):
    """ROC curve, from no alarm at all to an alarm in each run; threshold decreases, its first is +inf.

    tpr and auc are NaN without positives, fpr and auc without negatives. The last point also counts runs that never
    alarm (-inf): no threshold reaches it, and auc takes the way to it as a straight line, a coin thrown for them.
    """

    threshold: np.ndarray
    fpr: np.ndarray
    tpr: np.ndarray
    auc: float
    positives: int
    negatives: int


class PrecisionRecall(NamedTuple):
    """Precision-recall curve, recall falling from 1 to 0 with rising threshold; the last point (1, 0) has no threshold,
    +inf stands for it. All NaN without positives. base: share of positives, the precision of an alarm in each run."""

    threshold: np.ndarray
    precision: np.ndarray
    recall: np.ndarray
    average_precision: float
    base: float
    positives: int
    negatives: int


class CurveBand(NamedTuple):
    """A curve on a common grid with its bootstrap band, and the area under it with its own."""

    grid: np.ndarray  # of fpr or of recall
    curve: BootstrapBand  # tpr or precision, arrays as the grid
    area: BootstrapBand  # AUC or average precision


class OperatingPoint(NamedTuple):
    """What a threshold does: rates of alarms among positives and negatives, and of positives among alarms."""

    threshold: float
    tpr: Rate
    fpr: Rate
    precision: Rate


def roc(score: ArrayLike, positive: ArrayLike) -> Roc:
    """ROC curve of score [n] (any unit, may be infinite) against positive (bool [n]).

    ValueError where lengths differ or a score is NaN.
    """
    from sklearn.metrics import auc, roc_curve  # slow to import

    values, truth = _scored(score, positive)
    positives, negatives = int(truth.sum()), int((~truth).sum())
    if not len(values):
        nothing = np.full(1, np.nan)
        return Roc(np.full(1, np.inf), nothing, nothing, np.nan, 0, 0)
    level, place = np.unique(values, return_inverse=True)  # sklearn refuses infinities; only the order matters
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # one class alone: NaN tells it
        fpr, tpr, at = roc_curve(truth, place)
    area = float(auc(fpr, tpr)) if positives and negatives else float("nan")
    threshold = np.concatenate([[np.inf], level[at[1:].astype(int)]])
    return Roc(threshold, fpr, tpr, area, positives, negatives)


def precision_recall(score: ArrayLike, positive: ArrayLike) -> PrecisionRecall:
    """Precision-recall curve of score [n] (any unit, may be infinite) against positive (bool [n]).

    ValueError where lengths differ or a score is NaN.
    """
    from sklearn.metrics import average_precision_score, precision_recall_curve  # slow to import

    values, truth = _scored(score, positive)
    positives, negatives = int(truth.sum()), int((~truth).sum())
    if not positives:
        nothing = np.full(1, np.nan)
        base = 0.0 if negatives else float("nan")
        return PrecisionRecall(np.full(1, np.inf), nothing, nothing, float("nan"), base, 0, negatives)
    level, place = np.unique(values, return_inverse=True)
    precision, recall, at = precision_recall_curve(truth, place)
    threshold = np.concatenate([level[at.astype(int)], [np.inf]])
    area = float(average_precision_score(truth, place))
    return PrecisionRecall(threshold, precision, recall, area, positives / len(truth), positives, negatives)


def roc_band(
    score: ArrayLike,
    positive: ArrayLike,
    cluster: ArrayLike,
    confidence: float = 0.95,
    *,
    grid: np.ndarray = GRID,
    resamples: int = 1000,
    seed: int = 0,
) -> CurveBand:
    """tpr at each fpr of `grid`, and AUC, with bands that resample clusters (label [n]; np.arange(n) where each run
    stands alone). The bands are pointwise. Errors as in `roc` and `cluster_bootstrap`."""

    def curve(hits: np.ndarray, misses: np.ndarray) -> np.ndarray:
        tpr, fpr = (np.insert(part, 0, 0.0) / part[-1] for part in (hits, misses))
        return np.append(np.interp(grid, fpr, tpr), np.trapezoid(tpr, fpr))

    return _band(score, positive, cluster, curve, grid, confidence, resamples, seed)


def precision_recall_band(
    score: ArrayLike,
    positive: ArrayLike,
    cluster: ArrayLike,
    confidence: float = 0.95,
    *,
    grid: np.ndarray = GRID[1:],
    resamples: int = 1000,
    seed: int = 0,
) -> CurveBand:
    """Precision at the highest threshold whose recall reaches each value of `grid` (above 0), and average precision,
    with bands as those of `roc_band`."""

    def curve(hits: np.ndarray, misses: np.ndarray) -> np.ndarray:
        recall, precision = hits / hits[-1], hits / (hits + misses)
        reached = np.searchsorted(recall, grid * (1 - 1e-12))
        gained = np.diff(recall, prepend=0.0)
        return np.append(precision[reached], gained[gained > 0] @ precision[gained > 0])

    return _band(score, positive, cluster, curve, grid, confidence, resamples, seed)


def operating_points(
    score: ArrayLike, positive: ArrayLike, thresholds: ArrayLike, confidence: float = 0.95
) -> list[OperatingPoint]:
    """What each threshold [m] (unit of the score) does, with Wilson intervals; errors as in `roc`."""
    values, truth = _scored(score, positive)
    levels = np.atleast_1d(np.asarray(thresholds, float))
    hits, misses = alarms(values[truth], levels), alarms(values[~truth], levels)
    true = rates(hits, int(truth.sum()), confidence)
    false = rates(misses, int((~truth).sum()), confidence)
    precision = rates(hits, hits + misses, confidence)
    return [OperatingPoint(*point) for point in zip(levels.tolist(), true, false, precision, strict=True)]


def alarms(score: np.ndarray, thresholds: np.ndarray) -> np.ndarray:
    """How many of the scores [n] alarm at each threshold [m]: int [m]. NaN thresholds raise ValueError."""
    if np.isnan(thresholds).any():
        raise ValueError("a threshold must be a number or infinite, got NaN")
    able = np.sort(score[score > -np.inf])
    return len(able) - np.searchsorted(able, thresholds)


def _band(
    score: ArrayLike,
    positive: ArrayLike,
    cluster: ArrayLike,
    curve: Callable[[np.ndarray, np.ndarray], np.ndarray],
    grid: np.ndarray,
    confidence: float,
    resamples: int,
    seed: int,
) -> CurveBand:
    """Band of curve(hits, misses): positives and negatives [thresholds] at or above each distinct score, falling.

    scikit-learn takes one weighting at a time and sorts each time: some 5 times slower.
    """
    values, truth = _scored(score, positive)
    order = np.argsort(-values, kind="stable")
    falling = values[order]
    last = np.flatnonzero(np.append(falling[1:] != falling[:-1], True))  # of equal scores

    def statistic(weight: np.ndarray) -> np.ndarray:
        ordered = weight[:, order]
        hits = np.cumsum(ordered * truth[order], axis=1)[:, last]
        misses = np.cumsum(ordered * ~truth[order], axis=1)[:, last]
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.stack([curve(*pair) for pair in zip(hits, misses, strict=True)])

    band = cluster_bootstrap(cluster, statistic, confidence, resamples=resamples, seed=seed)
    value, low, high = (np.asarray(part) for part in band[:3])
    return CurveBand(
        grid,
        BootstrapBand(value[:-1], low[:-1], high[:-1], band.units, band.undefined[:-1]),
        BootstrapBand(float(value[-1]), float(low[-1]), float(high[-1]), band.units, int(band.undefined[-1])),
    )


def _scored(score: ArrayLike, positive: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    values, truth = np.asarray(score, float), np.asarray(positive).astype(bool)
    if values.shape != truth.shape or values.ndim != 1:
        raise ValueError(f"scores {values.shape} and labels {truth.shape} must be one-dimensional and of one length")
    if np.isnan(values).any():
        raise ValueError(f"{int(np.isnan(values).sum())} scores are NaN; a run that can never alarm scores -inf")
    return values, truth
