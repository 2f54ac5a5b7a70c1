"""Finds the smallest alarm threshold whose false-alarm rate is below a target, with stated
confidence.

The score of an operation is its maximum over time, so an operation has an alarm if its score
exceeds the threshold. A unit is one operator with all operations of this operator. Units are
independent. The loss of a unit, 0 to 1, is about the share of its operations with an alarm
(`FalseAlarmTarget` defines it). The risk of a threshold is the expected loss of a new unit.

The hypothesis that the risk is above the target is tested at 1 - confidence. A threshold is
accepted if the test rejects this hypothesis. A higher threshold has a lower risk.
`smallest_threshold` takes the smallest one that is accepted with all higher thresholds. With the
stated confidence over the draw of the units, its risk is below the target, for any distribution of
the scores (Bates et al., J. ACM 68, 2021, theorem 1).

The test is by betting (`excess_p`). It is valid for losses of any distribution. If the losses of
units differ little, fewer units are enough. With one operation per unit and a loss of 0 or 1, the
test is an exact binomial test, and the threshold is the order statistic of Wilks (Ann. Math. Stat.
12, 1941). A unit with several operations is a cluster and counts once. `first_operations` takes
one operation of each unit, called subsampling by Dunn, Wasserman, Ramdas (JASA 118, 2023).
"""

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
        """Number of sampled units."""
        return len(np.unique(self.unit))

    def taken_from(self, units: np.ndarray) -> "OperationScores":
        """Return the operations of the units whose numbers are in `units`, int [n]."""
        mask = np.isin(self.unit, units)
        return OperationScores(*(values[mask] for values in self))

    def first_operations(self) -> "OperationScores":
        """Return the first operation of each unit. These are independent of each other."""
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

    If H = T, L is A. If alarms do not end operations, a is about the largest share with an alarm.
    """

    per_hour: float  # largest rate of false alarms (r)
    confidence: float  # probability that a calibration keeps the limit
    length_h: float  # duration of an operation, hours (T)

    @property
    def risk(self) -> float:
        """The largest accepted mean loss of an operation (a)."""
        expected = self.per_hour * self.length_h
        return expected / (1.0 + expected)

    @property
    def min_units(self) -> int:
        """The smallest number n of independent units without an alarm that is enough to show the
        limit: (1 - risk)^n <= 1 - confidence.

        `risk` is r T / (1 + r T) with r = `per_hour`, T = `length_h`. n operations last about
        -ln(1 - confidence) / r hours. Raise ValueError unless r > 0, T > 0, 0 < confidence < 1.
        """
        expected = self.per_hour * self.length_h
        if not (self.per_hour > 0 and self.length_h > 0 and math.isfinite(expected)):
            raise ValueError(
                f"expected a rate per hour and a duration in hours above 0, got {self.per_hour}"
                f" and {self.length_h}"
            )
        units = math.log(alpha_of(self.confidence)) / math.log1p(-self.risk)
        # The tolerance prevents that rounding adds a unit.
        return max(1, math.ceil(units - 1e-9))

    @property
    def min_clusters(self) -> int:
        """The smallest number of units of several operations, all without loss, that is enough to
        show a mean loss of at most `risk` by the betting test of `excess_p`. Each unit multiplies
        the capital of the test by 1 + risk. The capital has to reach 1 / (1 - confidence). If
        detectors are not always active, more units are needed.
        """
        units = -math.log(alpha_of(self.confidence)) / math.log1p(self.risk)
        # The tolerance prevents that rounding adds a unit.
        return max(self.min_units, math.ceil(units - 1e-9))

    def without_alarm(self, hours: np.ndarray) -> np.ndarray:
        """Return the loss r (T - H) / (1 + r T) of operations without an alarm, [operations]. H:
        `hours` with active detectors; r: `per_hour`; T: `length_h`. Other hours do not show how
        rare alarms are, so they are a loss (see the class). Raise ValueError if H is not in 0..T.
        """
        # Rounding may make the hours slightly larger than the duration.
        if not ((hours >= 0) & (hours <= self.length_h * (1 + 1e-9))).all():
            raise ValueError(
                f"hours with active detectors, in an operation of {self.length_h:g} h, must be in"
                f" 0..{self.length_h:g}; got {hours.min():g}..{hours.max():g}"
            )
        inactive_hours = np.maximum(self.length_h - hours, 0.0)
        return self.per_hour * inactive_hours / (1.0 + self.per_hour * self.length_h)


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

    def __init__(self, units: int, min_units: int):
        super().__init__(f"got {units} units, expected at least {min_units}")
        self.units, self.min_units = units, min_units


def smallest_threshold(operations: "OperationScores", target: FalseAlarmTarget) -> Threshold:
    """Return the smallest score that, as a threshold, keeps the target with the target's
    confidence. Raise TooFewUnits if no score does.
    """
    if not len(operations.unit):
        raise TooFewUnits(0, target.min_units)
    score = np.where(np.isnan(operations.score), np.inf, operations.score)
    _, unit, sizes = np.unique(operations.unit, return_inverse=True, return_counts=True)
    base_loss = target.without_alarm(operations.hours)
    # Losses are 0 or 1 if each unit has one operation, with detectors active all the time.
    exact = bool(sizes.max() == 1 and (base_loss <= 1e-15).all())
    order = np.argsort(-score, kind="stable")
    # Different scores, descending, and the number of scores above each.
    negative_values, alarm_counts = np.unique(-score[order], return_index=True)
    # Units of the operations, highest score first, and what an alarm adds to the loss of the unit.
    ordered_unit = unit[order]
    added_loss = (1.0 - base_loss)[order] / sizes[ordered_unit]
    unit_base_loss = np.bincount(unit, base_loss) / sizes
    best: Threshold | None = None
    # From the highest threshold down to the first one that does not keep the target.
    for value, alarms in zip(-negative_values, alarm_counts, strict=True):
        # An infinite score exceeds every threshold, so it cannot be a threshold.
        if not np.isfinite(value):
            continue
        alarm_losses = np.bincount(ordered_unit[:alarms], added_loss[:alarms], len(sizes))
        p = excess_p(unit_base_loss + alarm_losses, target.risk, target.confidence, exact)
        if p > alpha_of(target.confidence):
            break
        best = Threshold(
            value=float(value),
            units=len(sizes),
            operations=len(score),
            hours=float(operations.hours.sum()),
            alarms=int(alarms),
            p=p,
        )
    if best is None:
        raise TooFewUnits(len(sizes), target.min_units)
    return best


def excess_p(losses: np.ndarray, risk: float, confidence: float, exact: bool = False) -> float:
    """Return the p-value of the hypothesis that the mean loss is above `risk`.

    losses: of independent units, [units] in 0..1. Their order must not depend on the losses.
    `exact`: losses are 0 or 1, and the p-value is that of their binomial sum. Otherwise the test
    is the betting test of Waudby-Smith and Ramdas (J. R. Stat. Soc. B 86, 2024). A capital of 1 is
    multiplied for each unit by 1 - bet * (loss - risk), so it grows if losses are below `risk`. If
    the hypothesis is true, the capital ever reaches c with a probability of at most 1 / c. Bets are
    the paper's predictable plug-in bets for this `confidence`, at most 1.
    """
    from scipy.stats import binom  # slow to import

    units = len(losses)
    if exact:
        return float(binom.cdf(round(float(losses.sum())), units, risk))
    count = np.arange(1, units + 1)
    # Mean and variance of the losses up to each unit, with one assumed loss of `risk` before them,
    # which has the variance risk / 4.
    mean = (risk + np.cumsum(losses)) / (1 + count)
    variance_after = (risk / 4 + np.cumsum((losses - mean) ** 2)) / (1 + count)
    # A bet may depend only on the losses before its own.
    variance = np.concatenate([[risk / 4], variance_after[:-1]])
    bet = np.minimum(1.0, np.sqrt(-2.0 * np.log(alpha_of(confidence)) / (units * variance)))
    log_capital = np.cumsum(np.log1p(-bet * (losses - risk)))
    # By Ville's inequality, the inverse of the largest capital is a p-value.
    return float(np.exp(-max(0.0, log_capital.max())))


SCALE_QUANTILE = 0.95
"""The scale of a signal is this quantile of the maxima of operations."""
MIN_SCALE = 1e-6
"""Smallest scale of a signal in a segment, as a fraction of its largest scale in any segment."""


def signal_scales(peaks: np.ndarray) -> np.ndarray:
    """Return the scale of each signal in each segment, float32 [signals, segments]: the quantile
    SCALE_QUANTILE of the operations' maxima. peaks: maxima of operations [operations, signals,
    segments]. A signal that is 0 in all segments has scale 1. Raise ValueError without operations,
    or if a maximum is infinite or NaN.
    """
    if not len(peaks) or not np.isfinite(peaks).all():
        raise ValueError(
            "expected operations with finite scores, got no operation or an infinite or NaN score"
        )
    scales = np.quantile(peaks, SCALE_QUANTILE, axis=0)
    # A signal that hardly changes in one segment gets a scale above 0 there.
    largest = scales.max(axis=-1, keepdims=True)
    scales = np.maximum(scales, MIN_SCALE * largest)
    return np.where(scales > 0, scales, 1.0).astype(np.float32)


def joint_scores(peaks: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """Return the score of each operation: the largest of its maxima divided by their scales.

    peaks: maxima [operations, signals * segments]. scales: [signals, segments]. A failed operation
    has a maximum NaN, and its score is infinite. The score equals, to the bit, the largest of a
    monitor's scores over time, because both use float32 and division keeps the order.
    """
    maxima = peaks.reshape(len(peaks), -1).astype(np.float32)
    scores = (maxima / scales.astype(np.float32).ravel()).max(axis=1)
    return np.where(np.isnan(scores), np.float32(np.inf), scores)
