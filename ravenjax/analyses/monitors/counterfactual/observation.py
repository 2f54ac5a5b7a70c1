"""Measures how candidate checks respond to fault-free motions and to the faults of a campaign.

All candidates run as detectors. The module stores each candidate's largest score in each fault-free
motion, and the time from each of its alarms to the harm.
"""

import itertools
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax import threads
from ravenjax.analyses.monitors.counterfactual.candidates import (
    Candidate,
    add_detectors,
    detector_tables,
)
from ravenjax.campaign import runner
from ravenjax.campaign.faults import design
from ravenjax.campaign.inspection import fault_free
from ravenjax.campaign.loading import validate_tables
from ravenjax.campaign.progress import OnProgress
from ravenjax.errors import UserError
from ravenjax.report.data import draws, facts
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import HARMFUL_EVADING
from ravenjax.report.sections import robots as drawn_robots
from ravenjax.stats import units
from ravenjax.stats.intervals import Rate, wilson_interval
from ravenjax.store.access import query
from ravenjax.store.access.query import RESULTS
from ravenjax.store.folder import Results
from ravenjax.store.manifest import Nested, read_manifest

SHORTEST_S, LONGEST_S = 5, 60
"""Shortest and longest duration of a motion, s."""
MIN_MOTIONS = 12
"""Smallest number of motions, so that each use has at least three."""
MAX_ALARMS = 0.2
"""Largest expected number of alarms per run. A run counts only one, so more would bias the rate."""
_USES = ("test", "scales", "test", "calibration")
"""Uses of the motions, in turn: test of the false-alarm rate, scales, calibration of the margin."""


class FreeMotion(NamedTuple):
    """Scores of fault-free motions. Each has another operator and one or several robots."""

    peaks: np.ndarray  # float32 [motions, runs, candidates], largest score in the run
    # [motions, runs], time in which detectors are active; 0 for a run without a valid outcome.
    hours: np.ndarray


class MotionSchedule(NamedTuple):
    """Number and length of the motions to compute."""

    seconds: int  # length of each run
    motions: int


def plan_motions(raw: Nested, hours: float) -> MotionSchedule:
    """Return the number of fault-free motions, and their length, that give the requested hours.

    Raise UserError if the campaign's motion does not depend on a seed.
    """
    fault_free.require_new_motions(raw)
    _, campaign = next(fault_free.fault_free_campaigns(raw, SHORTEST_S))
    # A motion has several runs if the campaign has several robots.
    runs = design.count_rows(validate_tables(campaign))
    # Length of a run if MIN_MOTIONS motions share the hours.
    needed_s = math.ceil(hours * 3600 / (MIN_MOTIONS * runs))
    seconds = int(np.clip(needed_s, SHORTEST_S, LONGEST_S))
    # In its first seconds the robot is not live, so a check cannot raise an alarm.
    live_s = seconds - fault_free.UNTIL_LIVE_S
    return MotionSchedule(seconds, max(MIN_MOTIONS, math.ceil(hours * 3600 / (live_s * runs))))


def require_rate(per_hour: float, schedule: MotionSchedule) -> None:
    """Raise UserError for a false-alarm rate that is too high for runs of this length.

    A run counts at most one alarm, so the rate of frequent alarms cannot be measured.
    """
    live_h = (schedule.seconds - fault_free.UNTIL_LIVE_S) / 3600
    if per_hour * live_h > MAX_ALARMS:
        raise UserError(
            f"--false-alarms-per-hour {per_hour:g} is one alarm in {3600 / per_hour:.3g} s. A run"
            f" of {schedule.seconds} s counts only one alarm and would miss others. Write"
            f" {MAX_ALARMS / live_h:.3g} or less, or fewer --hours, so that runs are shorter"
        )


def run_motions(
    raw: Nested,
    schedule: MotionSchedule,
    use: str,
    candidates: Sequence[Candidate],
    folder: Path,
    engine: str,
) -> FreeMotion:
    """Simulate the fault-free motions with this use, with all candidates as detectors.

    The files of the detectors are written to `folder`. Raise UserError if the robot is never live.
    """
    endless = fault_free.fault_free_campaigns(raw, schedule.seconds)
    campaigns = [campaign for _, campaign in itertools.islice(endless, schedule.motions)]
    tables = detector_tables(candidates, (1.0,), folder)
    numbers = [n for n in range(schedule.motions) if _USES[n % len(_USES)] == use]

    def simulate(number: int) -> tuple[np.ndarray, np.ndarray]:
        # Returns scores [runs, candidates] and hours [runs] of one motion; 0 for a failed run.
        config, prefixes = add_detectors(campaigns[number], tables)
        columns = [f"{prefix}score" for prefix in prefixes]
        results = runner.run_campaign(config, None, engine)
        table = results.frame([*columns, "pedal_down_ms", "failed"])
        valid = (table["failed"] == "").to_numpy()
        # A run without a valid outcome may have the value -1, which is no time.
        active_ms = np.maximum(table["pedal_down_ms"].to_numpy(float), 0.0)
        hours = np.where(valid, active_ms, 0.0) / fault_free.MS_PER_HOUR
        return table[columns].to_numpy(np.float32), hours

    # The first motion compiles the code that the others use. A motion fills few lanes of an engine,
    # so motions run in parallel threads.
    results = [simulate(numbers[0]), *threads.map_in_threads(simulate, numbers[1:])]
    scores = np.stack([score for score, _ in results])
    hours = np.stack([hour for _, hour in results])
    if not hours.sum() > 0:
        raise UserError(
            f"the robot is never live in {schedule.seconds} s of fault-free motion, or every run"
            " failed, so false alarms cannot be counted. Run a group without faults to see why"
        )
    # Runs without hours may have scores that are not numbers. These scores count as 0.
    return FreeMotion(np.where((hours > 0)[..., None], scores, 0.0), hours)


class EvadingFaults(NamedTuple):
    """Runs whose fault evades the robot's checks, one run of each fault; arrays over runs."""

    group: np.ndarray  # str, name of the fault's group
    sampled: np.ndarray  # bool, True if the group draws its faults at random
    unit: np.ndarray  # int, the independent unit: the fault, or the robot if robots were drawn
    units_are_robots: bool
    # int [runs, candidates, margins], time from first alarm to harm; below 0 without earlier alarm.
    lead_ms: np.ndarray

    @property
    def count(self) -> int:
        """Number of faults, each with one run."""
        return len(self.unit)

    def halves(self, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Divide the runs at random into halves for selection and for the test, both bool [runs].

        All runs of a unit are in the same half. If units are faults, each group is divided.
        """
        # The number 1 separates these draws from others with the same seed.
        rng = np.random.default_rng([seed, 1])
        selection = np.zeros(self.count, bool)
        # A robot has faults of several groups, so robots are divided as one stratum.
        strata = np.zeros(self.count, int)
        if not self.units_are_robots:
            _, strata = np.unique(self.group, return_inverse=True)
        start = 0
        for stratum in range(strata.max(initial=-1) + 1):
            shuffled = rng.permutation(np.unique(self.unit[strata == stratum]))
            selection |= (strata == stratum) & np.isin(self.unit, shuffled[start::2])
            # In groups of odd size one half gets one unit more: first the selection, then the test.
            start = (start + len(shuffled)) % 2
        return selection, ~selection

    def rate(self, detected: np.ndarray, rows: np.ndarray) -> Rate:
        """Return the share of the runs in `rows` that are `detected`; both are bool [runs].

        The interval is over faults, or over robots if whole robots were drawn.
        """
        if not self.units_are_robots:
            return wilson_interval(int(detected[rows].sum()), int(rows.sum()))
        return units.rate_band(detected[rows], units.group_units(self.unit[rows]))


NEVER = -(2**30)
"""Lead time of an alarm that was never raised."""


def run_evading_faults(
    raw: Nested,
    candidates: Sequence[Candidate],
    margins: Sequence[float],
    folder: Path,
    engine: str,
    groups: Sequence[str],
    on_progress: OnProgress | None,
) -> EvadingFaults:
    """Run the campaign with all candidates as detectors, and return its evading faults.

    `margins`: thresholds of every detector. `folder`: for the files of the detectors. `groups`:
    groups whose faults are returned; (): all. Raise UserError if no fault evades.
    """
    config, prefixes = add_detectors(raw, detector_tables(candidates, margins, folder))
    results = runner.run_campaign(config, None, engine, on_progress=on_progress)
    evading = read_evading_faults(results, groups)
    if evading.empty:
        among = f" of {', '.join(groups)}" if groups else ""
        raise UserError(
            f"no fault{among} evades the robot's checks with a motion of more than"
            f" {config.outcomes.limit_mm:g} mm: no further check is needed"
        )
    lead_ms = [detector_leads(evading, prefix, margins) for prefix in prefixes]
    group = evading["group"].astype(str).to_numpy()
    # Runs of one drawn robot have the same values in these columns.
    robot_columns = [name for name in drawn_robots.robot_columns(raw) if name in evading]
    unit = np.arange(len(evading))
    if robot_columns:
        unit = evading.groupby(robot_columns, sort=False).ngroup().to_numpy()
    sampled = np.isin(group, list(draws.drawn_groups(raw) or ()))
    return EvadingFaults(group, sampled, unit, bool(robot_columns), np.stack(lead_ms, axis=1))


def read_evading_faults(results: Results, groups: Sequence[str]) -> pd.DataFrame:
    """Return the rows of the evading faults in a result table, one row of each fault, with a column
    unintended_ms, the time of the harm. `groups`: groups whose faults are returned; (): all.
    """
    with query.open_folder(results.path) as table:
        facts.define_facts(table, facts.recorded_choices(read_manifest(results.path)))
        # A table with all candidates is large, so only the rows of these faults are read.
        rows = table.frame(
            f"SELECT {RESULTS}.*, unintended_ms FROM {RESULTS} JOIN {FACTS} USING (row) WHERE"
            f" {HARMFUL_EVADING} ORDER BY row"
        )
    return rows.loc[rows["group"].isin(groups)] if groups else rows


def detector_leads(evading: pd.DataFrame, prefix: str, thresholds: Sequence[float]) -> np.ndarray:
    """Return the time from a detector's first alarm to the harm, ms [runs, thresholds].

    `evading`: from `read_evading_faults`. `prefix`: beginning of the names of the detector's
    columns. The result is NEVER without an alarm. It is NEVER, too, if the golden run has an alarm,
    because such an alarm does not show the fault.
    """
    golden = evading[f"golden_{prefix}score"].to_numpy(np.float32)
    harm_ms = evading["unintended_ms"].to_numpy(np.int64)
    lead_ms = np.full((len(evading), len(thresholds)), NEVER)
    for index, threshold in enumerate(thresholds):
        alarm_ms = evading[f"{prefix}threshold{index}_first_ms"].to_numpy(np.int64)
        detected = (alarm_ms >= 0) & ~(golden > np.float32(threshold))
        lead_ms[detected, index] = (harm_ms - alarm_ms)[detected]
    return lead_ms
