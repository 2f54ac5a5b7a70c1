"""Computes the scales and the threshold of a monitor from scores of fault-free operations.

Some operators determine the scale of each score, some the threshold, and some test the monitor.
This use depends only on the operator's index. It does not change if operators are added.
"""

import math
from typing import NamedTuple

import numpy as np

from ravenjax.analyses.monitors.monitor import Monitor, Segments
from ravenjax.analyses.monitors.scores import Score
from ravenjax.errors import UserError
from ravenjax.stats.alarms.false_alarms import AlarmRate, ending_rate
from ravenjax.stats.conformal import threshold
from ravenjax.stats.conformal.threshold import (
    FalseAlarmTarget,
    OperationScores,
    Threshold,
    TooFewUnits,
)

ROUND_SIZE = 8
"""The use of operators repeats after this number. In each round the first operator determines
scales, the next THRESHOLD_OPERATORS determine the threshold, and the others test the monitor.
"""
THRESHOLD_OPERATORS = 4
RESERVE = 1.5
"""Factor on the smallest number of units, as a reserve for pedal-up time and a few alarms."""


class Uses(NamedTuple):
    """Which operations are used for scales, the threshold and the test; bool [operations]."""

    scale: np.ndarray
    threshold: np.ndarray
    test: np.ndarray


class Test(NamedTuple):
    """The monitor's alarms in operations that were not used for its calibration."""

    units: int  # number of operators
    operations: int
    hours: float  # total duration of the operations without an alarm
    alarms: int  # number of operations with an alarm
    first_operations: AlarmRate  # rate in each operator's first operation; these are independent

    @property
    def per_hour(self) -> float:
        """Number of operations with an alarm, per hour of operations without an alarm."""
        if not self.hours:
            return float("inf" if self.alarms else "nan")
        return self.alarms / self.hours


class Calibrated(NamedTuple):
    """A calibrated monitor, its target, and the results of calibration and test."""

    monitor: Monitor
    target: FalseAlarmTarget
    threshold: Threshold
    scale_units: int  # number of operators that determined the scales
    test: Test


def assign_uses(unit: np.ndarray) -> Uses:
    """Return the use of each operation. `unit`: number of its operator, [operations]."""
    # A round has one operator for scales, then THRESHOLD_OPERATORS for the threshold, then tests.
    number_in_round = unit % ROUND_SIZE
    return Uses(
        scale=number_in_round == 0,
        threshold=(number_in_round > 0) & (number_in_round <= THRESHOLD_OPERATORS),
        test=number_in_round > THRESHOLD_OPERATORS,
    )


def count_units(threshold_units: int) -> int:
    """Return how many operators to simulate, so that `threshold_units` of them determine the
    threshold and at least one tests the monitor.
    """
    # A round has one operator for scales, then THRESHOLD_OPERATORS for the threshold, then tests.
    full_rounds, rest = divmod(threshold_units, THRESHOLD_OPERATORS)
    units = full_rounds * ROUND_SIZE
    if rest:
        # The last round ends after its operator for scales and `rest` operators for the threshold.
        units += 1 + rest
    # The first operator for a test comes after those for scales and threshold of the first round.
    return max(units, 1 + THRESHOLD_OPERATORS + 1)


def require_hours(hours: float) -> None:
    """Raise UserError if the hours are infinite or NaN."""
    if not math.isfinite(hours):
        raise UserError(f"--hours is {hours}, expected a number above 0, such as 20")


def operators_within(target: FalseAlarmTarget, operations: int, hours: float | None) -> int:
    """Return the number of operators to simulate: as many as fit into `hours`.

    If `hours` is None, RESERVE times as many operators determine the threshold as the target needs
    at least. operations: number of operations of each operator. Raise UserError, with the hours
    that are needed, if the hours are too few.
    """
    if hours is None:
        return count_units(int(np.ceil(RESERVE * target.min_clusters)))
    require_hours(hours)
    least = count_units(target.min_clusters)
    # The tolerance prevents that rounding loses an operator.
    operators = int(hours / (operations * target.length_h) + 1e-9)
    if operators < least:
        min_hours = least * operations * target.length_h
        alternative = ""
        # With one robot, each operator has one operation, so as many operators need fewer hours.
        if operations > 1:
            alternative = f", or --robots 1 --hours {np.ceil(min_hours / operations):g}"
        raise UserError(
            f"--hours {hours:g} is enough time for {operators} operators. To show at most"
            f" {target.per_hour:g} false alarms an hour with {target.confidence:.0%} confidence,"
            f" {least} operators are needed. Write --hours {np.ceil(min_hours):g} or"
            f" more{alternative}"
        )
    return operators


def calibrate_thresholds(
    peaks: OperationScores, terms: tuple[Score, ...], segments: Segments, target: FalseAlarmTarget
) -> Calibrated:
    """Return a monitor with calibrated scales and threshold, and its alarms in a test.

    `peaks`: the largest score of each term in each segment of each operation, [operations, terms *
    segments]. Different operators determine scales and threshold, and test the monitor. Raise
    UserError if the operations are too few for the target.
    """
    uses = assign_uses(peaks.unit)
    # A failed operation cannot determine a scale.
    has_scales = uses.scale & np.isfinite(peaks.score).all(axis=1)
    if not has_scales.any():
        raise UserError(
            "the scales of the monitor's signals cannot be computed: a signal became infinite or"
            " NaN in every operation that determines scales. Change campaign.seed or [parameters]"
        )
    shape = (-1, len(terms), segments.count)
    scales = threshold.signal_scales(peaks.score[has_scales].reshape(shape))
    scores = peaks._replace(score=threshold.joint_scores(peaks.score, scales))
    calibrating = OperationScores(*(values[uses.threshold] for values in scores))
    try:
        result = threshold.smallest_threshold(calibrating, target)
    except TooFewUnits as error:
        inactive = 1.0 - float(calibrating.hours.mean()) / target.length_h
        failed = float((~np.isfinite(calibrating.score)).mean())
        raise UserError(
            f"{error.units} operators are too few to show at most {target.per_hour:g} false alarms"
            f" an hour with {target.confidence:.0%} confidence. {failed:.2%} of their operations"
            " failed and count as false alarms. The time in which the robot does not follow the"
            f" operator, {inactive:.0%}, is left out. Write more --hours (finished operations are"
            " kept), allow more false alarms, or change the campaign so that fewer operations fail"
        ) from None
    monitor = Monitor(terms, segments, tuple(map(tuple, scales.tolist())), result.value)
    tested = OperationScores(*(values[uses.test] for values in scores))
    alarms, first = tested.score > result.value, tested.first_operations()
    test = Test(
        units=tested.units,
        operations=len(alarms),
        hours=float(tested.hours[~alarms].sum()),
        alarms=int(alarms.sum()),
        first_operations=ending_rate(first.score > result.value, first.hours),
    )
    scale_units = len(np.unique(peaks.unit[uses.scale]))
    return Calibrated(monitor, target, result, scale_units, test)
