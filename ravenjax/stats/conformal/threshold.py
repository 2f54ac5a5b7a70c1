"""Finds the smallest alarm threshold whose false-alarm rate is below a target, with stated
confidence.

The score of an operation is its maximum over time, so an operation has an alarm if its score
exceeds the threshold. The sampled units are operators, each with some robots. A unit's loss is the
mean over its operations (`target`), in 0..1, and losses of units are independent. The risk of a
threshold is the expected loss of a new unit.

The hypothesis that the risk is above the target is tested at 1 - confidence. A threshold is
accepted if the test rejects this hypothesis. Risk falls with the threshold. So the smallest
threshold for which it and all higher thresholds are accepted keeps the target with that confidence.
This is true over the draw of the units and for any distribution of the scores (Bates et al., J. ACM
68, 2021, theorem 1).

The test is by betting (`excess_p`). It is valid for losses of any distribution and needs fewer
units the less they differ. With one operation per unit, whose loss is 0 or 1, the test is exact. It
then equals the order statistic of Wilks (Ann. Math. Stat. 12, 1941): as many alarms among n as the
binomial tail allows. Units with several operations are clusters and are counted as units.
`one_each` takes one operation of each unit, called subsampling by Dunn, Wasserman, Ramdas (JASA
118, 2023).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ravenjax.stats.intervals import alpha_of


class OperationScores(NamedTuple):
    """Scores of fault-free operations, arrays of one length."""

    unit: np.ndarray  # int, number of the operator
    score: np.ndarray  # maximum over the operation; infinite or NaN: above every threshold
    hours: np.ndarray  # time of the operation in which detectors are active

    @property
    def units(self) -> int:
        """Return the number of sampled units."""
        return len(np.unique(self.unit))

    def taken_from(self, units: np.ndarray) -> OperationScores:
        """Return the operations of these units."""
        mask = np.isin(self.unit, units)
        return OperationScores(*(values[mask] for values in self))

    def one_each(self) -> OperationScores:
        """Return the first operation of each unit: these are independent of each other."""
        _, first = np.unique(self.unit, return_index=True)
        return OperationScores(*(values[first] for values in self))


class FalseAlarmTarget(NamedTuple):
    """A limit of false alarms per hour with a confidence, and the equivalent loss of an operation.

    An operation lasts T hours, and an alarm ends it, as an E-stop does. Let A = 1 if the operation
    has an alarm, else 0, and let H <= T be the hours in which detectors are active. The rate over
    many operations is E[A] divided by the mean hours to the alarm or the end. It is at most r if

        E[A] <= r E[(1 - A) H]

    because hours before an alarm are left out. This is equivalent to E[L] <= a for a loss L in 0..1
    of each operation.

        L = A + (1 - A) r (T - H) / (1 + r T),        a = r T / (1 + r T)

    If H = T, L is A. If alarms do not end operations, a is approximately the largest share of
    operations with an alarm.
    """

    per_hour: float  # largest rate of false alarms (r)
    confidence: float  # probability that a calibration keeps the limit
    length_h: float  # duration of an operation, hours (T)

    @property
    def risk(self) -> float:
        """Return the largest mean loss of an operation."""
        expected = self.per_hour * self.length_h
        return expected / (1.0 + expected)

    @property
    def fewest_units(self) -> int:
        """Return the smallest number n of independent units without an alarm that is enough to show
        the limit: (1 - a)^n <= 1 - c.

        n times the length of an operation is about -ln(1 - c) / r, for any length. Raise ValueError
        unless rate and length are above 0 and the confidence is between 0 and 1.
        """
        if not (
            self.per_hour > 0 and self.length_h > 0 and math.isfinite(self.per_hour * self.length_h)
        ):
            raise ValueError(
                f"expected a rate and a length above 0, got {self.per_hour} an hour and"
                f" {self.length_h} h"
            )
        # Tolerance, so that rounding does not add a unit.
        return max(
            1, math.ceil(math.log(alpha_of(self.confidence)) / math.log1p(-self.risk) - 1e-9)
        )

    @property
    def fewest_clusters(self) -> int:
        """Return the smallest number n of units without loss that is enough, if units have several
        operations or detectors are not always active.

        The capital of the betting test grows by the factor 1 + a per unit: (1 + a)^n >= 1 / (1 -
        c). If detectors are not always active, more units are needed.
        """
        return max(
            self.fewest_units,
            math.ceil(-math.log(alpha_of(self.confidence)) / math.log1p(self.risk) - 1e-9),
        )

    def without_alarm(self, hours: np.ndarray) -> np.ndarray:
        """Return the loss of operations without an alarm [operations].

        hours: time in which detectors are active [operations]. Raise ValueError outside of 0..T.
        """
        if not ((hours >= 0) & (hours <= self.length_h * (1 + 1e-9))).all():
            raise ValueError(
                f"hours of an operation must be in 0..{self.length_h:g}, got"
                f" {hours.min():g}..{hours.max():g}"
            )
        return (
            self.per_hour
            * np.maximum(self.length_h - hours, 0.0)
            / (1.0 + self.per_hour * self.length_h)
        )


class Threshold(NamedTuple):
    """A threshold and the data from which it was computed."""

    value: float  # scores above this value are alarms
    units: int  # number of sampled units
    operations: int
    hours: float  # total time in which detectors are active
    alarms: int  # number of operations with an alarm
    p: float  # p-value of the hypothesis that the risk is above the target


class TooFewUnits(ValueError):
    """Raised if the units are too few for any threshold. It states how many would be enough."""

    def __init__(self, units: int, fewest: int) -> None:
        super().__init__(f"got {units} units, expected at least {fewest}")
        self.units, self.fewest = units, fewest


def least_threshold(operations: OperationScores, target: FalseAlarmTarget) -> Threshold:
    """Return the smallest score that keeps the target as a threshold. Raise TooFewUnits."""
    if not len(operations.unit):
        raise TooFewUnits(0, target.fewest_units)
    score = np.where(np.isnan(operations.score), np.inf, operations.score)
    _, unit, sizes = np.unique(operations.unit, return_inverse=True, return_counts=True)
    base = target.without_alarm(operations.hours)
    exact = bool(sizes.max() == 1 and (base <= 1e-15).all())
    order = np.argsort(-score, kind="stable")
    # Different scores, descending, and the number of scores above each.
    values, above = np.unique(-score[order], return_index=True)
    owner, more = unit[order], (1.0 - base)[order] / sizes[unit[order]]
    quiet = np.bincount(unit, base) / sizes  # loss of each unit without an alarm
    best: Threshold | None = None
    for value, alarms in zip(-values, above, strict=True):
        if not np.isfinite(value):
            continue
        losses = quiet + np.bincount(owner[:alarms], more[:alarms], len(sizes))
        p = excess_p(losses, target.risk, target.confidence, exact)
        if p > alpha_of(target.confidence):
            break
        hours = float(operations.hours.sum())
        best = Threshold(float(value), len(sizes), len(score), hours, int(alarms), p)
    if best is None:
        raise TooFewUnits(len(sizes), target.fewest_units)
    return best


def excess_p(losses: np.ndarray, risk: float, confidence: float, exact: bool = False) -> float:
    """Return the p-value of the hypothesis that the mean loss is above `risk`.

    losses: of independent units, [units] in 0..1. Their order must not depend on the losses.
    `exact`: losses are 0 or 1, so their sum is binomial. Otherwise the test bets against the
    hypothesis, one unit after the other. The capital begins with 1, and each unit multiplies it by
    1 - bet * (loss - risk). If the hypothesis is true, the capital ever reaches 20 with a
    probability of at most 1 in 20. Bets are the predictable plug-in bets of Waudby-Smith and
    Ramdas (J. R. Stat. Soc. B 86, 2024) for this confidence, at most 1.
    """
    from scipy.stats import binom  # slow to import

    units = len(losses)
    if exact:
        return float(binom.cdf(round(float(losses.sum())), units, risk))
    t = np.arange(1, units + 1)
    mean = (risk + np.cumsum(losses)) / (1 + t)
    after = (risk / 4 + np.cumsum((losses - mean) ** 2)) / (1 + t)
    variance = np.concatenate([[risk / 4], after[:-1]])  # uses only losses before the unit
    bet = np.minimum(1.0, np.sqrt(-2.0 * np.log(alpha_of(confidence)) / (units * variance)))
    capital = np.cumsum(np.log1p(-bet * (losses - risk)))
    return float(np.exp(-max(0.0, capital.max())))


SHARE = 0.95
"""The scale of a signal is this quantile of the maxima of operations."""
LEAST = 1e-6
"""Smallest scale of a signal in a segment, as a fraction of its largest scale in any segment."""


def signal_scales(peaks: np.ndarray) -> np.ndarray:
    """Return the scale of each signal in each segment, float32 [signals, segments].

    peaks: maxima of operations [operations, signals, segments]. A signal that is 0 in all segments
    has scale 1. Raise ValueError without operations, or if a maximum is infinite or NaN.
    """
    if not len(peaks) or not np.isfinite(peaks).all():
        raise ValueError("scales need finite maxima of at least one operation")
    level = np.quantile(peaks, SHARE, axis=0)
    largest = level.max(axis=-1, keepdims=True)
    level = np.maximum(level, LEAST * largest)
    return np.where(level > 0, level, 1.0).astype(np.float32)


def joint_scores(peaks: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the score of each operation: the largest of its maxima divided by their scales.

    peaks: maxima [operations, signals * segments]. scale: [signals, segments]. A failed operation
    has a maximum NaN, and its score is infinite. The computation is in float32, as in a monitor.
    Division by a positive number keeps the order. So the score equals, to the bit, the largest of
    the monitor's scores over time.
    """
    shares = peaks.reshape(len(peaks), -1).astype(np.float32) / scale.astype(np.float32).ravel()
    scores = shares.max(axis=1)
    return np.where(np.isnan(scores), np.float32(np.inf), scores)
