"""ROC and precision-recall against two normals of known separation, scikit-learn and hand computation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import norm
from sklearn.metrics import average_precision_score, roc_auc_score

from ravenjax.stats.alarms.roc import operating_points, precision_recall, precision_recall_band, roc, roc_band
from ravenjax.stats.intervals import wilson

SEPARATION = 1.2
AUC = norm.cdf(SEPARATION / math.sqrt(2))


def normals(n, seed, separation=SEPARATION):
    random = np.random.default_rng(seed)
    positive = np.arange(n) < n // 3
    return random.normal(size=n) + separation * positive, positive


def test_auc_of_two_normals():
    score, positive = normals(60_000, 0)
    curve = roc(score, positive)
    assert curve.auc == pytest.approx(AUC, abs=0.006)  # 3.5 standard errors
    known = norm.sf(norm.isf(np.array([0.05, 0.2, 0.5])) - SEPARATION)
    assert np.interp([0.05, 0.2, 0.5], curve.fpr, curve.tpr) == pytest.approx(known, abs=0.015)


def test_by_hand_with_ties_and_infinities():
    # scores of positives: inf, 3, 2, -inf; of negatives: 3, 1, -inf. 12 pairs: inf beats 3, 3 beats 2 and draws 1,
    # 2 beats 2, -inf draws 1: 7 + 2 / 2 = 8 -> 8 / 12
    score, positive = [np.inf, 3, 2, -np.inf, 3, 1, -np.inf], [1, 1, 1, 1, 0, 0, 0]
    curve = roc(score, positive)
    assert curve.auc == pytest.approx(8 / 12) and (curve.positives, curve.negatives) == (4, 3)
    at = dict(zip(curve.threshold[1:], zip(curve.fpr[1:], curve.tpr[1:], strict=True), strict=True))
    assert at[3] == pytest.approx((1 / 3, 1 / 2)) and at[2] == pytest.approx((1 / 3, 3 / 4))
    assert (curve.threshold[0], curve.fpr[0], curve.tpr[0]) == (np.inf, 0, 0) and at[-np.inf] == (1, 1)
    # falling thresholds: precision 1/1 at recall 1/4, 2/3 at 1/2, 3/4 at 3/4, 3/5 at 3/4, 4/7 at 1
    found = precision_recall(score, positive)
    assert found.average_precision == pytest.approx((1 + 2 / 3 + 3 / 4 + 4 / 7) / 4) and found.base == 4 / 7
    assert found.precision[found.threshold == 2] == pytest.approx(3 / 4)


def test_one_class_alone():
    none = roc([1.0, 2.0], [False, False])
    assert math.isnan(none.auc) and np.isnan(none.tpr).all() and none.fpr[-1] == 1 and none.positives == 0
    all_ = roc([1.0, 2.0], [True, True])
    assert math.isnan(all_.auc) and np.isnan(all_.fpr).all() and all_.tpr[-1] == 1
    assert math.isnan(roc([], []).auc)
    empty = precision_recall([1.0, 2.0], [False, False])
    assert math.isnan(empty.average_precision) and np.isnan(empty.recall).all() and empty.base == 0


def test_bands_start_from_scikit_learns_values():
    score, positive = normals(300, 1)
    score = score.round(1)  # ties
    score[:9] = -np.inf
    places = np.unique(score, return_inverse=True)[1]
    band = roc_band(score, positive, np.arange(300), resamples=50)
    assert band.area.value == pytest.approx(roc_auc_score(positive, places))
    curve = roc(score, positive)
    assert band.curve.value == pytest.approx(np.interp(band.grid, curve.fpr, curve.tpr))
    pr = precision_recall_band(score, positive, np.arange(300), resamples=50)
    assert pr.area.value == pytest.approx(average_precision_score(positive, places))
    whole = precision_recall(score, positive)
    for x, y in zip(pr.grid, pr.curve.value, strict=True):
        assert y == whole.precision[np.flatnonzero(whole.recall >= x - 1e-12)[-1]]


@pytest.mark.slow
def test_coverage_of_the_auc_band():
    bands = [roc_band(*normals(150, seed), np.arange(150), resamples=150, seed=seed) for seed in range(100)]
    inside = np.mean([band.area.low <= AUC <= band.area.high for band in bands])
    assert inside > 0.87
    tpr = norm.sf(norm.isf(bands[0].grid[20]) - SEPARATION)
    assert np.mean([band.curve.low[20] <= tpr <= band.curve.high[20] for band in bands]) > 0.87


def test_repeated_runs_do_not_narrow_the_band():
    score, positive = normals(100, 2)
    once = roc_band(score, positive, np.arange(100), seed=1)
    often = roc_band(np.tile(score, 8), np.tile(positive, 8), np.tile(np.arange(100), 8), seed=1)
    assert often.area[:4] == pytest.approx(once.area[:4])
    as_if_new = roc_band(np.tile(score, 8), np.tile(positive, 8), np.arange(800), seed=1)
    assert as_if_new.area.high - as_if_new.area.low < 0.5 * (once.area.high - once.area.low)


def test_resamples_without_positives_are_counted():
    positive = np.arange(40) < 2
    band = roc_band(np.arange(40.0), positive, np.arange(40), resamples=400)
    assert band.area.undefined == pytest.approx(400 * (38 / 40) ** 40, abs=30)
    assert band.area[:3] == (0, 0, 0)  # of the rest: each positive scores below each negative
    assert (band.curve.undefined == band.area.undefined).all()
    nobody = roc_band(np.arange(40.0), np.zeros(40, bool), np.arange(40), resamples=20)
    assert math.isnan(nobody.area.value) and nobody.area.undefined == 20


def test_operating_points():
    score = np.array([5, 4, 3, -np.inf, 4, 2, 1, -np.inf])
    positive = np.repeat([True, False], 4)
    at4, everything, nothing = operating_points(score, positive, [4, -np.inf, np.inf])
    assert (at4.tpr, at4.fpr, at4.precision) == (wilson(2, 4), wilson(1, 4), wilson(2, 3))
    assert (everything.tpr.k, everything.fpr.k) == (3, 3)  # what scores -inf never alarms
    assert nothing.precision.n == 0 and math.isnan(nothing.precision.value)
    (censored,) = operating_points([1.0], [False], [0.5])
    assert math.isnan(censored.tpr.value) and censored.fpr.value == 1


@pytest.mark.parametrize("call", [roc, precision_recall, lambda s, p: operating_points(s, p, [1])])
def test_bad_scores_are_refused(call):
    with pytest.raises(ValueError, match="1 scores are NaN"):
        call([np.nan, 1], [True, False])
    with pytest.raises(ValueError, match="one length"):
        call([1], [True, False])
