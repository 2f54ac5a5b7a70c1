"""ROC and precision-recall against two normals of known separation, scikit-learn and hand
computation.
"""

import math

import numpy as np
import pytest
from scipy.stats import norm
from sklearn.metrics import (
    average_precision_score,
    precision_recall_curve,
    roc_auc_score,
    roc_curve,
)

from ravenjax.stats.alarms.roc import curve_bands

SEPARATION = 1.2
AUC = norm.cdf(SEPARATION / math.sqrt(2))


def normals(n, seed, separation=SEPARATION):
    random = np.random.default_rng(seed)
    positive = np.arange(n) < n // 3
    return random.normal(size=n) + separation * positive, positive


def test_bands_start_from_scikit_learns_values():
    score, positive = normals(300, 1)
    score = score.round(1)  # ties
    score[:9] = -np.inf
    places = np.unique(score, return_inverse=True)[1]
    band, pr = curve_bands(score, positive, np.arange(300), resamples=50)
    assert band.area.value == pytest.approx(roc_auc_score(positive, places))
    fpr, tpr, _ = roc_curve(positive, places)
    assert band.curve.value == pytest.approx(np.interp(band.grid, fpr, tpr))
    assert pr.area.value == pytest.approx(average_precision_score(positive, places))
    precision, recall, _ = precision_recall_curve(positive, places)
    for x, y in zip(pr.grid, pr.curve.value, strict=True):
        assert y == precision[np.flatnonzero(recall >= x - 1e-12)[-1]]


@pytest.mark.slow
def test_coverage_of_the_auc_band():
    bands = [
        curve_bands(*normals(150, seed), np.arange(150), resamples=150, seed=seed)[0]
        for seed in range(100)
    ]
    inside = np.mean([band.area.low <= AUC <= band.area.high for band in bands])
    assert inside > 0.87
    tpr = norm.sf(norm.isf(bands[0].grid[20]) - SEPARATION)
    assert np.mean([band.curve.low[20] <= tpr <= band.curve.high[20] for band in bands]) > 0.87


def test_repeated_runs_do_not_narrow_the_band():
    score, positive = normals(100, 2)
    once, _ = curve_bands(score, positive, np.arange(100), seed=1)
    copies = np.tile(score, 8), np.tile(positive, 8)
    often, _ = curve_bands(*copies, np.tile(np.arange(100), 8), seed=1)
    assert often.area == pytest.approx(once.area)
    as_if_new, _ = curve_bands(*copies, np.arange(800), seed=1)
    assert as_if_new.area.high - as_if_new.area.low < 0.5 * (once.area.high - once.area.low)


def test_bad_scores_are_refused():
    with pytest.raises(ValueError, match="1 scores are NaN"):
        curve_bands([np.nan, 1], [True, False], np.arange(2))
