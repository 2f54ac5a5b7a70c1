"""Calibrates a monitor on scores of operations: some give the scales, some the threshold, some test
it.

Operators are dealt to three uses by their number, whatever their scores, so that more of them
change no earlier one's.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ravenjax.analyses.monitors.monitor import Monitor, Segments
from ravenjax.analyses.monitors.score_folder import Peaks
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
"""Operators of a round: the first learns scales, CALIBRATES of them set the threshold, the
others test it.
"""
CALIBRATES = 4
ROOM = 1.5
"""Times the fewest units that are taken where nobody says how many hours: for pedal-up, and for
an alarm or two.
"""


class Uses(NamedTuple):
    """Which operations serve what, bool [operations]."""

    scale: np.ndarray
    threshold: np.ndarray
    test: np.ndarray


class Test(NamedTuple):
    """What the monitor did in operations that had no part in it."""

    units: int
    operations: int
    hours: float  # of operations without an alarm, which are those that the promise is about
    alarms: int  # operations with one
    one_each: AlarmRate  # of the first operation of each unit, which are independent

    @property
    def per_hour(self) -> float:
        """Operations with an alarm an hour without one, over all operations: the rate that is
        promised.
        """
        if not self.hours:
            return float("inf" if self.alarms else "nan")
        return self.alarms / self.hours


class Calibrated(NamedTuple):
    """A monitor and what it rests on."""

    monitor: Monitor
    target: FalseAlarmTarget
    threshold: Threshold
    learned_units: int
    test: Test


def uses(unit: np.ndarray) -> Uses:
    """By the numbers of their operators."""
    place = unit % ROUND
    return Uses(place == 0, (place > 0) & (place <= CALIBRATES), place > CALIBRATES)


def units_for(calibrating: int) -> int:
    """Least number of operators of which so many set the threshold, and one or more test it."""
    rounds, rest = divmod(calibrating, CALIBRATES)
    return max(rounds * ROUND + (rest + 1 if rest else 0), CALIBRATES + 2)


def require_hours(hours: float) -> None:
    """UserError for what is no length of time."""
    if not math.isfinite(hours):
        raise UserError(f"--hours {hours}: expected a number above 0, as 20")


def units_within(target: FalseAlarmTarget, robots: int, hours: float | None) -> int:
    """How many operators to compute: what `hours` of operation hold, or what the target needs with
    ROOM to spare.

    Raises UserError where the hours cannot do, with how many would.
    """
    fewest = units_for(target.fewest_clusters)
    if hours is None:
        return units_for(int(np.ceil(ROOM * target.fewest_clusters)))
    require_hours(hours)
    units = int(hours / (robots * target.length_h) + 1e-9)
    if units < fewest:
        least = fewest * robots * target.length_h
        raise UserError(
            f"{hours:g} h are {units} operators with {robots} operations of"
            f" {target.length_h * 60:g} min each; {target.per_hour:g} false alarms an hour with"
            f" {target.confidence:.0%} confidence need {fewest}, {target.fewest_clusters} of them"
            f" to set the threshold: --hours {np.ceil(least):g} or more. "
            + (f"With --robots 1 it would be {np.ceil(least / robots):g}" if robots > 1 else "")
        )
    return units


def calibrate(
    peaks: Peaks,
    terms: tuple[Score, ...],
    segments: Segments,
    target: FalseAlarmTarget,
    robots: int,
) -> Calibrated:
    """The monitor of `terms`. Raises UserError where the operations cannot carry the promise."""
    by = uses(peaks.unit)
    valid = by.scale & np.isfinite(peaks.peak).all(axis=1)
    if not valid.any():
        raise UserError(
            "no operation learns scales: all that should had a number that is not finite"
        )
    shape = (-1, len(terms), segments.count)
    scale = threshold.scales(peaks.peak[valid].reshape(shape))
    score = joint(peaks, scale)
    whole = OperationScores(peaks.unit, score, peaks.hours)
    calibrating = OperationScores(*(values[by.threshold] for values in whole))
    try:
        result = threshold.least(calibrating, target)
    except TooFewUnits as error:
        start = (
            f"{error.units} operators do not carry {target.per_hour:g} false alarms an hour with "
            f"{target.confidence:.0%} confidence"
        )
        raise UserError(
            f"{start}. {_reason(calibrating, len(peaks.unit), target, robots)}"
        ) from None
    monitor = Monitor(terms, segments, tuple(tuple(map(float, row)) for row in scale), result.value)
    tested = OperationScores(*(values[by.test] for values in whole))
    return Calibrated(
        monitor, target, result, len(np.unique(peaks.unit[by.scale])), test(tested, result.value)
    )


def _reason(
    calibrating: OperationScores, operations: int, target: FalseAlarmTarget, robots: int
) -> str:
    """Why no threshold keeps the target, and what to do; operations: how many there are in all."""
    failed = float((~np.isfinite(calibrating.score)).mean())
    if failed:
        return (
            f"{failed:.2%} of the operations failed or had a number that is not finite, which is an"
            f" alarm at every threshold, and {target.risk:.2%} with an alarm are promised at most:"
            " let the campaign draw robots that work, or allow more alarms"
        )
    lost = 1.0 - calibrating.hours.mean() / target.length_h
    follows = max(1.0 - lost, 0.1)
    wanted = units_for(int(np.ceil(ROOM * target.fewest_clusters / follows))) * robots
    enough = np.ceil(max(wanted, 1.1 * operations) * target.length_h)
    return (
        f"At least {target.fewest_clusters} are needed where the robot follows the operator all the"
        f" time, and more here, where it does not for {lost:.0%} of it: give more --hours, as"
        f" {enough:.0f} (what is computed stays), or allow more alarms"
    )


def joint(peaks: Peaks, scale: np.ndarray) -> np.ndarray:
    """Score of each operation; infinite where a number was not finite. scale: float32 [terms,
    segments].
    """
    score = threshold.joint(peaks.peak.reshape(len(peaks.peak), *scale.shape), scale)
    return np.where(np.isnan(score), np.float32(np.inf), score)


def test(operations: OperationScores, limit: float) -> Test:
    """Alarms in operations that set nothing."""
    alarms, first = operations.score > limit, operations.one_each()
    return Test(
        units=operations.units,
        operations=len(alarms),
        hours=float(operations.hours[~alarms].sum()),
        alarms=int(alarms.sum()),
        one_each=ending_rate(first.score > limit, first.hours),
    )
