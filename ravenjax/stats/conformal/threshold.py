"""The least threshold whose false-alarm rate is kept with confidence, from operations whose units
were sampled.

The score of an operation is its maximum over time, so it has an alarm where that is above the
threshold. The sampled units are operators, each with some robots: its loss is the mean over its
operations (`target`), in 0..1, and losses of units are independent. A threshold is rejected until
the hypothesis that its risk is above the target is refuted at 1 - confidence. Risk falls with the
threshold, so the least one for which that holds for it and all above it keeps the target with
that confidence (Bates, Angelopoulos, Lei, Malik, Jordan, Distribution-free, risk-controlling
prediction sets, J. ACM 68, 2021, theorem 1), over the draw of the units and for any distribution
of the scores.

The hypothesis is refuted by betting (`excess_p`), which holds for losses of any distribution and
asks for fewer units the less they differ. With one operation a unit, each counting whole, it is
refuted exactly, and this is the order statistic of Wilks (Ann. Math. Stat. 12, 1941): as many
alarms among n as the binomial tail allows. Clusters, as units with several operations, are counted
as units; Dunn, Wasserman, Ramdas (JASA 118, 2023) call taking one operation of each subsampling,
and it is what `one_each` does.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ravenjax.stats.intervals import alpha_of


class OperationScores(NamedTuple):
    """Fault-free operations, arrays of one length."""

    unit: np.ndarray  # int, which operator, any numbers
    score: np.ndarray  # maximum over the operation; infinite or NaN: above every threshold
    hours: np.ndarray  # that count

    @property
    def units(self) -> int:
        """How many were sampled."""
        return len(np.unique(self.unit))

    def taken_from(self, units: np.ndarray) -> OperationScores:
        """Those of these units."""
        mask = np.isin(self.unit, units)
        return OperationScores(*(values[mask] for values in self))

    def one_each(self) -> OperationScores:
        """The first operation of each unit: independent, whatever a unit's operations share."""
        _, first = np.unique(self.unit, return_index=True)
        return OperationScores(*(values[first] for values in self))


class FalseAlarmTarget(NamedTuple):
    """A limit of false alarms an hour and its confidence, also expressed as the risk of one
    operation.

    An operation lasts T hours, and an alarm ends it, as an E-stop does. With A = 1 where it has an
    alarm and H <= T the hours of it that count, the rate over many operations is E[A] over the mean
    hours to the alarm or the end, and that is at most r where

        E[A] <= r E[(1 - A) H]

    which leaves out what was worked before an alarm. That is linear, and the same as E[L] <= a for
    a loss L in 0..1 of each operation by itself:

        L = A + (1 - A) r (T - H) / (1 + r T),        a = r T / (1 + r T)

    Where all of T counts, L is A. Nothing is approximated; where alarms do not end operations, a is
    about those with one.
    """

    per_hour: float  # false alarms an hour, at most
    confidence: float  # that a calibration keeps it
    length_h: float  # of an operation, hours

    @property
    def risk(self) -> float:
        """Largest mean loss of an operation."""
        expected = self.per_hour * self.length_h
        return expected / (1.0 + expected)

    @property
    def fewest_units(self) -> int:
        """Independent units, none with an alarm, from which on the promise can be made at all: (1 -
        a)^n <= 1 - c.

        Hours of operation from independent operators are what counts: units times length is about
        -ln(1 - c) / r, whatever the length. ValueError unless rate and length are above 0 and the
        confidence lies between 0 and 1.
        """
        if not (
            self.per_hour > 0 and self.length_h > 0 and math.isfinite(self.per_hour * self.length_h)
        ):
            raise ValueError(
                f"a rate and a length lie above 0, got {self.per_hour} an hour and"
                f" {self.length_h} h"
            )
        # so that rounding does not ask for one more
        return max(
            1, math.ceil(math.log(alpha_of(self.confidence)) / math.log1p(-self.risk) - 1e-9)
        )

    @property
    def fewest_clusters(self) -> int:
        """The same for units of several operations, or of which not every hour counts, without any
        loss: a bet of 1 against the risk grows by 1 + a each, (1 + a)^n >= 1 / (1 - c). Hours that
        do not count ask for more."""
        return max(
            self.fewest_units,
            math.ceil(-math.log(alpha_of(self.confidence)) / math.log1p(self.risk) - 1e-9),
        )

    def without_alarm(self, hours: np.ndarray) -> np.ndarray:
        """Loss of operations without an alarm, by the hours of each that count; [operations].

        ValueError where hours are outside 0..T.
        """
        if not ((hours >= 0) & (hours <= self.length_h * (1 + 1e-9))).all():
            raise ValueError(
                f"hours of an operation lie in 0..{self.length_h:g}, got"
                f" {hours.min():g}..{hours.max():g}"
            )
        return (
            self.per_hour
            * np.maximum(self.length_h - hours, 0.0)
            / (1.0 + self.per_hour * self.length_h)
        )


class Threshold(NamedTuple):
    """A threshold, and what it rests on."""

    value: float  # alarms are scores above it
    units: int  # that were sampled
    operations: int
    hours: float  # that count
    alarms: int  # operations above it
    p: float  # of the hypothesis that the risk is above the target


class TooFewUnits(ValueError):
    """No threshold can be promised; says how many units would do."""

    def __init__(self, units: int, fewest: int) -> None:
        super().__init__(f"{units} units, at least {fewest} are needed")
        self.units, self.fewest = units, fewest


def least(operations: OperationScores, target: FalseAlarmTarget) -> Threshold:
    """The least score that keeps the target as a threshold. Raises TooFewUnits where none does."""
    if not len(operations.unit):
        raise TooFewUnits(0, target.fewest_units)
    score = np.where(np.isnan(operations.score), np.inf, operations.score)
    _, unit, sizes = np.unique(operations.unit, return_inverse=True, return_counts=True)
    base = target.without_alarm(operations.hours)
    exact = bool(sizes.max() == 1 and (base <= 1e-15).all())
    order = np.argsort(-score, kind="stable")
    values, above = np.unique(
        -score[order], return_index=True
    )  # descending; how many scores are above each
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
    """p-value of "the mean loss is above `risk`" from those of independent units, [units] in 0..1,
    in any order that was not chosen by their losses.

    exact: losses are 0 or 1, so their sum is binomial. Else by betting against it unit by unit: the
    capital grows by 1 - bet (loss - risk), and were the mean above the risk, it would reach 20 at
    any time with a chance of 1 in 20 at most (Waudby-Smith, Ramdas, J. R. Stat. Soc. B 86, 2024,
    with their predictable plug-in bets of at most 1, aimed at this confidence). Units whose losses
    differ little so need be few.
    """
    from scipy.stats import binom  # slow to import

    units = len(losses)
    if exact:
        return float(binom.cdf(round(float(losses.sum())), units, risk))
    t = np.arange(1, units + 1)
    mean = (risk + np.cumsum(losses)) / (1 + t)
    after = (risk / 4 + np.cumsum((losses - mean) ** 2)) / (1 + t)
    variance = np.concatenate([[risk / 4], after[:-1]])  # known before the unit
    bet = np.minimum(1.0, np.sqrt(-2.0 * np.log(alpha_of(confidence)) / (units * variance)))
    capital = np.cumsum(np.log1p(-bet * (losses - risk)))
    return float(np.exp(-max(0.0, capital.max())))


SHARE = 0.95
"""Quantile of an operation's maxima that is the scale of a signal in a segment."""
LEAST = 1e-6
"""Scale of a signal that is always less, times its largest scale in any segment."""


def scales(peaks: np.ndarray) -> np.ndarray:
    """Scale of each signal in each segment from maxima [operations, signals, segments]; float32
    [signals, segments].

    A signal that is 0 in all segments has scale 1 there. ValueError without operations, or where
    one is not finite.
    """
    if not len(peaks) or not np.isfinite(peaks).all():
        raise ValueError("scales are learned on finite maxima of at least one operation")
    level = np.quantile(peaks, SHARE, axis=0)
    largest = level.max(axis=-1, keepdims=True)
    level = np.maximum(level, LEAST * largest)
    return np.where(level > 0, level, 1.0).astype(np.float32)


def joint(peaks: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """The score of each operation: the largest of its maxima [operations, signals, segments] in
    their scales.

    In float32, as a monitor computes it: division by a positive number keeps the order, so this is
    the largest over time of what the monitor has in each millisecond, to the bit.
    """
    shares = peaks.astype(np.float32) / scale.astype(np.float32)
    return shares.reshape(len(peaks), -1).max(axis=1)
