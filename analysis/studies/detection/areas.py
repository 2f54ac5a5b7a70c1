"""Areas under ROC curves of several detectors on the same runs, their differences, and how sure
these are.

Faults of one kind resemble each other, so variances are of kinds: Obuchowski, Biometrics 53, 1997,
which is DeLong's (Biometrics 44, 1988) where each run is a kind of its own. A closed form, since a
bootstrap of all pairs would cost minutes; no library at hand has it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ravenjax.stats.bootstrap.clusters import codes
from ravenjax.stats.intervals import alpha_of
from studies.framework.study import StudyEstimate


class Areas(NamedTuple):
    """AUC of each detector [d] and their covariance [d, d]; NaN without positives or negatives."""

    value: np.ndarray
    covariance: np.ndarray
    positives: int
    negatives: int

    def estimate(
        self, d: int, confidence: float = 0.95, of: str = "positive runs"
    ) -> StudyEstimate:
        """One area with its normal interval, within 0..1; of: what the positive runs are."""
        low, high = _interval(self.value[d], self.covariance[d, d], confidence)
        return StudyEstimate(
            float(self.value[d]), max(0.0, low), min(1.0, high), self.positives, of
        )

    def difference(
        self, d: int, than: int, confidence: float = 0.95
    ) -> tuple[StudyEstimate, float]:
        """Area d minus area `than` of the same runs, and the two-sided p-value that they are alike;
        1 where they are the same score."""
        from scipy.stats import norm

        gap = float(self.value[d] - self.value[than])
        variance = float(
            self.covariance[d, d] + self.covariance[than, than] - 2 * self.covariance[d, than]
        )
        estimate = StudyEstimate(
            gap, *_interval(gap, variance, confidence), self.positives, "positive runs"
        )
        if variance <= 1e-18:
            return estimate, 1.0 if abs(gap) < 1e-12 else 0.0
        return estimate, float(2 * norm.sf(abs(gap) / np.sqrt(variance)))


def areas(score: np.ndarray, positive: np.ndarray, kind: np.ndarray) -> Areas:
    """Areas of score [runs, detectors] against positive (bool [runs]); `kind` [runs] is each run's
    cluster.

    ValueError where lengths differ or a score is NaN.
    """
    from scipy.stats import rankdata

    score, positive = np.asarray(score, float), np.asarray(positive, bool)
    if score.ndim != 2 or score.shape[:1] != positive.shape or positive.shape != np.shape(kind):
        raise ValueError(
            f"scores {score.shape}, labels {positive.shape} and kinds {np.shape(kind)} do not fit"
        )
    if np.isnan(score).any():
        raise ValueError(f"{int(np.isnan(score).sum())} scores are NaN")
    m, n, detectors = int(positive.sum()), int((~positive).sum()), score.shape[1]
    if not m or not n:
        return Areas(np.full(detectors, np.nan), np.full((detectors, detectors), np.nan), m, n)
    rank = rankdata(score, axis=0)
    # share of the other class that a run beats, a tie counting half
    beats = np.empty_like(rank)
    beats[positive] = (rank[positive] - rankdata(score[positive], axis=0)) / n
    beats[~positive] = 1.0 - (rank[~positive] - rankdata(score[~positive], axis=0)) / m
    value = beats[positive].mean(axis=0)
    code, clusters = codes(kind)
    both = np.zeros((detectors, detectors))
    scaled = []
    for members, count in ((positive, m), (~positive, n)):
        sums = np.zeros((clusters, detectors))
        np.add.at(sums, code[members], beats[members] - value)
        units = len(np.unique(code[members]))
        both += _more(units) * (sums.T @ sums) / count**2
        scaled.append(sums / count)
    cross = scaled[0].T @ scaled[1]
    return Areas(value, both + _more(clusters) * (cross + cross.T), m, n)


def _more(units: int) -> float:
    """Correction for few clusters."""
    return units / (units - 1) if units > 1 else np.nan


def _interval(value: float, variance: float, confidence: float) -> tuple[float, float]:
    from scipy.stats import norm

    half = norm.isf(alpha_of(confidence) / 2) * np.sqrt(max(variance, 0.0))
    return float(value - half), float(value + half)
