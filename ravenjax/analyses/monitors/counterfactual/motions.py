"""Runs fault-free motion with every candidate as a detector, and keeps the largest scores."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax import threads
from ravenjax.analyses.monitors.counterfactual import candidates
from ravenjax.analyses.monitors.counterfactual.candidates import Candidate
from ravenjax.analyses.monitors.operations import MS_PER_HOUR
from ravenjax.campaign import runner
from ravenjax.campaign.faults import design
from ravenjax.campaign.file.config import validate_tables
from ravenjax.campaign.inspection import fault_free
from ravenjax.errors import UserError

SHORTEST_S, LONGEST_S = 5, 60
"""Length of a motion, s."""
FEWEST = 12
"""Fewest motions in total, so that each share has a few."""
MOST_ALARMS = 0.2
"""Largest expected number of alarms per run at the target rate; a run counts at most one."""
_SHARES = ("stated", "scales", "stated", "calibrated")
"""Use of each motion, in turn."""


class FreeMotion(NamedTuple):
    """Motions, each of a different operator, and one run or more of each, with drawn robots."""

    peaks: np.ndarray  # float32 [motions, runs, candidates], largest score over the run
    # [motions, runs], in which detectors can alarm; 0 for a run without a valid outcome.
    hours: np.ndarray

    @property
    def motions(self) -> int:
        """Return the number of sampled operators."""
        return len(self.hours)


class MotionSchedule(NamedTuple):
    """Number and length of the motions to compute."""

    seconds: int  # length of each run
    motions: int


def plan_motions(raw: Mapping[str, Any], hours: float) -> MotionSchedule:
    """Return motions for the requested hours. Raises UserError if there are no other motions."""
    fault_free.require_others(raw)
    runs = design.count_rows(
        validate_tables(next(fault_free.fault_free_campaigns(raw, SHORTEST_S))[1])
    )
    seconds = int(np.clip(math.ceil(hours * 3600 / (FEWEST * runs)), SHORTEST_S, LONGEST_S))
    useful = seconds - fault_free.UNTIL_LIVE_S
    return MotionSchedule(seconds, max(FEWEST, math.ceil(hours * 3600 / (useful * runs))))


def require_rate(per_hour: float, course: MotionSchedule) -> None:
    """Raise UserError for a rate that runs of this length, with one alarm each, cannot measure."""
    useful_h = (course.seconds - fault_free.UNTIL_LIVE_S) / 3600
    if per_hour * useful_h > MOST_ALARMS:
        raise UserError(
            f"--false-alarms-per-hour {per_hour:g} is one in {3600 / per_hour:.3g} s, and runs of"
            f" {course.seconds} s count one alarm at most: ask for {MOST_ALARMS / useful_h:.3g} or"
            f" fewer, or give fewer --hours, which makes runs shorter, down to {SHORTEST_S} s"
        )


def motions_by_use(name: str, motions: int) -> list[int]:
    """Return the numbers of the motions with one use."""
    return [number for number in range(motions) if _SHARES[number % len(_SHARES)] == name]


def run_motions(
    raw: Mapping[str, Any],
    course: MotionSchedule,
    numbers: Sequence[int],
    parts: Sequence[Candidate],
    folder: Path,
    engine: str,
    on_motion: Callable[[], None] = lambda: None,
) -> FreeMotion:
    """Compute the motions of these numbers in threads, because a motion fills few lanes."""
    every = itertools.islice(fault_free.fault_free_campaigns(raw, course.seconds), course.motions)
    campaigns = dict(enumerate(config for _, config in every))

    tables = candidates.detector_tables(parts, (1.0,), folder)

    def one(number: int) -> tuple[np.ndarray, np.ndarray]:
        config, prefixes = candidates.with_detectors(campaigns[number], tables)
        columns = [f"{prefix}score" for prefix in prefixes]
        results = runner.run_campaign(config, None, engine)
        table = results.frame([*columns, "pedal_down_ms", "failed"])
        valid = (table["failed"] == "").to_numpy()
        armed = np.maximum(table["pedal_down_ms"].to_numpy(float), 0.0)
        on_motion()
        return table[columns].to_numpy(np.float32), np.where(valid, armed, 0.0) / MS_PER_HOUR

    first = [one(numbers[0])]  # compiles the code that the other motions share
    results = first + threads.map_in_threads(one, numbers[1:])
    free = FreeMotion(*map(np.stack, zip(*results, strict=True)))
    if not free.hours.sum() > 0:
        raise UserError(
            f"{course.seconds} s of fault-free motion have no valid millisecond in which the robot"
            " is live, so nothing can be said of false alarms"
        )
    return FreeMotion(np.where((free.hours > 0)[..., None], free.peaks, 0.0), free.hours)
