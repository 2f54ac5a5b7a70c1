"""Computes the scales and the threshold of a monitor from scores of fault-free operations.

Some operators determine the scale of each score, some the threshold, and some test the monitor. The
number of an operator determines this use. Additional operators therefore do not change the use of
earlier operators.
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

ROUND = 8
"""The use of operators repeats after this number. In each round the first operator determines
scales, the next CALIBRATES determine the threshold, and the others test the monitor.
"""
CALIBRATES = 4
ROOM = 1.5
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
    one_each: AlarmRate  # rate in the first operation of each operator; these are independent

    @property
    def per_hour(self) -> float:
        """Return the number of operations with an alarm, per hour of operations without alarms."""
        if not self.hours:
            return float("inf" if self.alarms else "nan")
        return self.alarms / self.hours


class Calibrated(NamedTuple):
    """A calibrated monitor, its target, and the results of calibration and test."""

    monitor: Monitor
    target: FalseAlarmTarget
    threshold: Threshold
    learned_units: int
    test: Test


def assign_uses(unit: np.ndarray) -> Uses:
    """Return the use of each operation, by the number of its operator."""
    place = unit % ROUND
    return Uses(place == 0, (place > 0) & (place <= CALIBRATES), place > CALIBRATES)


def units_for(calibrating: int) -> int:
    """Return the number of operators of which `calibrating` determine the threshold and at least
    one tests the monitor.
    """
    rounds, rest = divmod(calibrating, CALIBRATES)
    return max(rounds * ROUND + (rest + 1 if rest else 0), CALIBRATES + 2)


def require_hours(hours: float) -> None:
    """Raise UserError if the hours are not a valid length of time."""
    if not math.isfinite(hours):
        raise UserError(f"--hours is {hours}, expected a number above 0, such as 20")


def units_within(target: FalseAlarmTarget, robots: int, hours: float | None) -> int:
    """Return the number of operators to simulate: as many as fit into `hours`, or ROOM times the
    number that the target needs.

    robots: operations of each operator. Raise UserError if the hours are too few; the message
    states the number of hours that are needed.
    """
    fewest = units_for(target.fewest_clusters)
    if hours is None:
        return units_for(int(np.ceil(ROOM * target.fewest_clusters)))
    require_hours(hours)
    units = int(hours / (robots * target.length_h) + 1e-9)
    if units < fewest:
        least = fewest * robots * target.length_h
        fewer = f", or --robots 1 --hours {np.ceil(least / robots):g}" if robots > 1 else ""
        raise UserError(
            f"{hours:g} h are enough for {units} operators, but to show at most"
            f" {target.per_hour:g} false alarms an hour with {target.confidence:.0%} confidence,"
            f" {fewest} operators are needed: write --hours {np.ceil(least):g} or more{fewer}"
        )
    return units


def calibrate_thresholds(
    peaks: OperationScores, terms: tuple[Score, ...], segments: Segments, target: FalseAlarmTarget
) -> Calibrated:
    """Return the calibrated monitor of `terms`, whose scores are the columns of `peaks`.

    Raise UserError if the operations are too few for the target.
    """
    by = assign_uses(peaks.unit)
    valid = by.scale & np.isfinite(peaks.score).all(axis=1)
    if not valid.any():
        raise UserError(
            "scales cannot be computed: each operation that determines scales had an infinite or"
            " NaN number. Let the campaign draw other robots"
        )
    shape = (-1, len(terms), segments.count)
    scale = threshold.signal_scales(peaks.score[valid].reshape(shape))
    whole = peaks._replace(score=threshold.joint_scores(peaks.score, scale))
    calibrating = OperationScores(*(values[by.threshold] for values in whole))
    try:
        result = threshold.least_threshold(calibrating, target)
    except TooFewUnits as error:
        lost = 1.0 - float(calibrating.hours.mean()) / target.length_h
        failed = float((~np.isfinite(calibrating.score)).mean())
        raise UserError(
            f"{error.units} operators are too few for {target.per_hour:g} false alarms an hour with"
            f" {target.confidence:.0%} confidence. {failed:.2%} of the operations failed, which"
            f" counts as an alarm at every threshold, and in {lost:.0%} of the time the robot does"
            " not follow the operator. Write more --hours (finished operations are kept), allow"
            " more false alarms, or let the campaign draw robots that work"
        ) from None
    monitor = Monitor(terms, segments, tuple(tuple(map(float, row)) for row in scale), result.value)
    tested = OperationScores(*(values[by.test] for values in whole))
    alarms, first = tested.score > result.value, tested.one_each()
    test = Test(
        units=tested.units,
        operations=len(alarms),
        hours=float(tested.hours[~alarms].sum()),
        alarms=int(alarms.sum()),
        one_each=ending_rate(first.score > result.value, first.hours),
    )
    return Calibrated(monitor, target, result, len(np.unique(peaks.unit[by.scale])), test)
