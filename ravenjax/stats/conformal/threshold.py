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
    """Fault-free operations, arrays of one length."""

    unit: np.ndarray  # int, number of the operator
    score: np.ndarray  # maximum over the operation; infinite or NaN: above every threshold
    hours: np.ndarray  # that count

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
    """A limit of false alarms per hour and its confidence, also expressed as the risk of one
    operation.

    An operation lasts T hours, and an alarm ends it, as an E-stop does. Let A = 1 if it has an
    alarm, and H <= T its hours that count. The rate over many operations is E[A] divided by the
    mean hours to the alarm or the end. It is at most r if

        E[A] <= r E[(1 - A) H]

    This leaves out the hours before an alarm. It is linear. It is equivalent to E[L] <= a for a
    loss L in 0..1 of each single operation.

        L = A + (1 - A) r (T - H) / (1 + r T),        a = r T / (1 + r T)

    If all of T counts, L is A. Nothing is approximated. If alarms do not end operations, a applies
    approximately to operations with an alarm.
    """

    per_hour: float  # false alarms an hour, at most
    confidence: float  # that a calibration keeps the limit
    length_h: float  # of an operation, hours

    @property
    def risk(self) -> float:
        """Return the largest mean loss of an operation."""
        expected = self.per_hour * self.length_h
        return expected / (1.0 + expected)

    @property
    def fewest_units(self) -> int:
        """Return the number of independent units, all without an alarm, from which a promise is
        possible: (1 - a)^n <= 1 - c.

        What counts is hours of operation of independent operators: units times length is about
        -ln(1 - c) / r, for any length. Raises ValueError unless rate and length are above 0 and the
        confidence lies between 0 and 1.
        """
        if not (
            self.per_hour > 0 and self.length_h > 0 and math.isfinite(self.per_hour * self.length_h)
        ):
            raise ValueError(
                f"a rate and a length must be above 0, got {self.per_hour} an hour and"
                f" {self.length_h} h"
            )
        # Tolerance, so that rounding does not add a unit.
        return max(
            1, math.ceil(math.log(alpha_of(self.confidence)) / math.log1p(-self.risk) - 1e-9)
        )

    @property
    def fewest_clusters(self) -> int:
        """Return the number of units without any loss, for units of several operations or with
        hours that do not count.

        A bet of 1 against the risk grows by the factor 1 + a per unit: (1 + a)^n >= 1 / (1 - c). If
        some hours do not count, more units are needed.
        """
        return max(
            self.fewest_units,
            math.ceil(-math.log(alpha_of(self.confidence)) / math.log1p(self.risk) - 1e-9),
        )

    def without_alarm(self, hours: np.ndarray) -> np.ndarray:
        """Return the loss of operations without an alarm, by the hours of each that count;
        [operations].

        Raises ValueError if hours are outside 0..T.
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
    """A threshold and the data behind it."""

    value: float  # alarms are scores above it
    units: int  # number of sampled units
    operations: int
    hours: float  # that count
    alarms: int  # number of operations above it
    p: float  # p-value of the hypothesis that the risk is above the target


class TooFewUnits(ValueError):
    """Raised if no threshold can be promised. States how many units would suffice."""

    def __init__(self, units: int, fewest: int) -> None:
        super().__init__(f"{units} units, at least {fewest} are needed")
        self.units, self.fewest = units, fewest


def least_threshold(operations: OperationScores, target: FalseAlarmTarget) -> Threshold:
    """Return the least score that keeps the target as threshold. Raises TooFewUnits."""
    if not len(operations.unit):
        raise TooFewUnits(0, target.fewest_units)
    score = np.where(np.isnan(operations.score), np.inf, operations.score)
    _, unit, sizes = np.unique(operations.unit, return_inverse=True, return_counts=True)
    base = target.without_alarm(operations.hours)
    exact = bool(sizes.max() == 1 and (base <= 1e-15).all())
    order = np.argsort(-score, kind="stable")
    values, above = np.unique(
        -score[order], return_index=True
    )  # scores, descending, and the number of scores above each
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
    """Return the p-value of "the mean loss is above `risk`" from losses of independent units,
    [units] in 0..1.

    The order of the units must not depend on their losses. `exact`: losses are 0 or 1, so their sum
    is binomial. Otherwise the test bets against the hypothesis, one unit after the other. It starts
    with capital 1, and each unit multiplies the capital by 1 - bet * (loss - risk). If the mean
    were above the risk, the chance that the capital ever reaches 20 would be at most 1 in 20
    (Waudby-Smith, Ramdas, J. R. Stat. Soc. B 86, 2024, with their predictable plug-in bets of at
    most 1, aimed at this confidence). If the losses differ little, few units are enough.
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
"""Quantile of an operation's maxima that is the scale of a signal in a segment."""
LEAST = 1e-6
"""Least scale of a signal in a segment, as a fraction of its largest scale in any segment."""


def signal_scales(peaks: np.ndarray) -> np.ndarray:
    """Return the scale of each signal in each segment from maxima [operations, signals, segments];
    float32 [signals, segments].

    A signal that is 0 in all segments has scale 1. Raises ValueError without operations, or if a
    maximum is not finite.
    """
    if not len(peaks) or not np.isfinite(peaks).all():
        raise ValueError("scales need finite maxima of at least one operation")
    level = np.quantile(peaks, SHARE, axis=0)
    largest = level.max(axis=-1, keepdims=True)
    level = np.maximum(level, LEAST * largest)
    return np.where(level > 0, level, 1.0).astype(np.float32)


def joint_scores(peaks: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return the score of each operation: the largest of its maxima [operations, signals *
    segments], each divided by its scale [signals, segments]. An operation that failed has a maximum
    NaN; its score is infinite.

    The computation is in float32, as in a monitor. Division by a positive number keeps the order,
    so this equals, to the bit, the largest value over time of the monitor's scores per millisecond.
    """
    shares = peaks.reshape(len(peaks), -1).astype(np.float32) / scale.astype(np.float32).ravel()
    scores = shares.max(axis=1)
    return np.where(np.isnan(scores), np.float32(np.inf), scores)
