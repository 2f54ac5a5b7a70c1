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
"""Operators of a round: one gives scales, CALIBRATES set the threshold, the others test."""
CALIBRATES = 4
ROOM = 1.5
"""Factor on the fewest units: room for pedal-up time and an alarm or two."""


class Uses(NamedTuple):
    """The use of each operation, bool [operations]."""

    scale: np.ndarray
    threshold: np.ndarray
    test: np.ndarray


class Test(NamedTuple):
    """What the monitor did in operations that had no part in its calibration."""

    units: int
    operations: int
    hours: float  # hours of operations without an alarm, to which the promise refers
    alarms: int  # operations with an alarm
    one_each: AlarmRate  # over the first operation of each unit, which are independent

    @property
    def per_hour(self) -> float:
        """Return operations with an alarm per hour without one, over all operations."""
        if not self.hours:
            return float("inf" if self.alarms else "nan")
        return self.alarms / self.hours


class Calibrated(NamedTuple):
    """A calibrated monitor and the data behind it."""

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
    """Return the least number of operators with `calibrating` for the threshold and one test."""
    rounds, rest = divmod(calibrating, CALIBRATES)
    return max(rounds * ROUND + (rest + 1 if rest else 0), CALIBRATES + 2)


def require_hours(hours: float) -> None:
    """Raise UserError if the hours are not a valid length of time."""
    if not math.isfinite(hours):
        raise UserError(f"--hours {hours}: expected a number above 0, such as 20")


def units_within(target: FalseAlarmTarget, robots: int, hours: float | None) -> int:
    """Return the number of operators to compute: as many as fit into `hours`, or as many as the
    target needs, with ROOM to spare.

    Raises UserError if the hours are too few, with the number that would do.
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
            f"{hours:g} h allow {units} operators, but at most {target.per_hour:g} false alarms an"
            f" hour with {target.confidence:.0%} confidence need {fewest} operators: write --hours"
            f" {np.ceil(least):g} or more{fewer}"
        )
    return units


def calibrate_thresholds(
    peaks: OperationScores, terms: tuple[Score, ...], segments: Segments, target: FalseAlarmTarget
) -> Calibrated:
    """Return the monitor of `terms`, whose scores are the columns of `peaks`.

    Raises UserError if operations do not support the promise.
    """
    by = assign_uses(peaks.unit)
    valid = by.scale & np.isfinite(peaks.score).all(axis=1)
    if not valid.any():
        raise UserError(
            "scales cannot be learned: every operation for them had a number that is not finite"
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
            f" {target.confidence:.0%} confidence. {failed:.2%} of the operations failed, which is"
            f" an alarm at every threshold, and in {lost:.0%} of the time the robot does not follow"
            " the operator. Give more --hours (what is computed stays), allow more alarms, or let"
            " the campaign draw robots that work"
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
