"""Measures how candidate checks respond to fault-free motions and to the faults of a campaign.

All candidates run as detectors. The module stores each candidate's largest score in each fault-free
motion, and the time from each of its alarms to the harm.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax import threads
from ravenjax.analyses.monitors.counterfactual import candidates
from ravenjax.analyses.monitors.counterfactual.candidates import Candidate
from ravenjax.analyses.monitors.operations import MS_PER_HOUR
from ravenjax.campaign import runner
from ravenjax.campaign.faults import design
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.inspection import fault_free
from ravenjax.campaign.loading import validate_tables
from ravenjax.campaign.progress import OnProgress
from ravenjax.errors import UserError
from ravenjax.report.data import draws, facts
from ravenjax.report.sections import robots as drawn_robots
from ravenjax.stats.bootstrap import units
from ravenjax.stats.intervals import Rate, wilson_interval
from ravenjax.store import schema
from ravenjax.vocabulary.reactions import ACTIONS

SHORTEST_S, LONGEST_S = 5, 60
"""Shortest and longest duration of a motion, s."""
FEWEST = 12
"""Smallest number of motions, so that each use has at least three."""
MOST_ALARMS = 0.2
"""Largest expected number of alarms per run. Only one alarm of a run is counted, so more alarms
would make the measured rate too small.
"""
_SHARES = ("stated", "scales", "stated", "calibrated")
"""Uses of the motions, in turn: statement of the rate, scales, margin."""


class FreeMotion(NamedTuple):
    """Scores of fault-free motions. Each motion has another operator, and one or several runs with
    different robots.
    """

    peaks: np.ndarray  # float32 [motions, runs, candidates], largest score in the run
    # [motions, runs], time in which detectors are active; 0 for a run without a valid outcome.
    hours: np.ndarray


class MotionSchedule(NamedTuple):
    """Number and length of the motions to compute."""

    seconds: int  # length of each run
    motions: int


def plan_motions(raw: Mapping[str, Any], hours: float) -> MotionSchedule:
    """Return number and length of the motions for the requested hours.

    Raise UserError if the campaign's motion does not depend on a seed.
    """
    fault_free.require_new_motions(raw)
    runs = design.count_rows(
        validate_tables(next(fault_free.fault_free_campaigns(raw, SHORTEST_S))[1])
    )
    seconds = int(np.clip(math.ceil(hours * 3600 / (FEWEST * runs)), SHORTEST_S, LONGEST_S))
    useful = seconds - fault_free.UNTIL_LIVE_S
    return MotionSchedule(seconds, max(FEWEST, math.ceil(hours * 3600 / (useful * runs))))


def require_rate(per_hour: float, course: MotionSchedule) -> None:
    """Raise UserError for a false-alarm rate that is too high for runs of this length.

    A run counts at most one alarm, so the rate of frequent alarms cannot be measured.
    """
    useful_h = (course.seconds - fault_free.UNTIL_LIVE_S) / 3600
    if per_hour * useful_h > MOST_ALARMS:
        raise UserError(
            f"--false-alarms-per-hour {per_hour:g} is one alarm in {3600 / per_hour:.3g} s, but a"
            f" run of {course.seconds} s counts only one. Write {MOST_ALARMS / useful_h:.3g} or"
            f" less, or fewer --hours, which makes runs shorter (at least {SHORTEST_S} s)"
        )


def motions_by_use(name: str, motions: int) -> list[int]:
    """Return the numbers of the motions with the use `name`."""
    return [number for number in range(motions) if _SHARES[number % len(_SHARES)] == name]


def run_motions(
    raw: Mapping[str, Any],
    course: MotionSchedule,
    numbers: Sequence[int],
    parts: Sequence[Candidate],
    folder: Path,
    engine: str,
) -> FreeMotion:
    """Simulate the motions with these numbers, with all candidates as detectors."""
    every = itertools.islice(fault_free.fault_free_campaigns(raw, course.seconds), course.motions)
    campaigns = dict(enumerate(config for _, config in every))

    tables = candidates.detector_tables(parts, (1.0,), folder)

    def one(number: int) -> tuple[np.ndarray, np.ndarray]:
        # Returns scores and hours of one fault-free motion; a failed run has no hours.
        config, prefixes = candidates.with_detectors(campaigns[number], tables)
        columns = [f"{prefix}score" for prefix in prefixes]
        results = runner.run_campaign(config, None, engine)
        table = results.frame([*columns, "pedal_down_ms", "failed"])
        valid = (table["failed"] == "").to_numpy()
        armed = np.maximum(table["pedal_down_ms"].to_numpy(float), 0.0)
        return table[columns].to_numpy(np.float32), np.where(valid, armed, 0.0) / MS_PER_HOUR

    # The first motion compiles the code that the others use. A motion fills few lanes of an engine,
    # so motions run in parallel threads.
    first = [one(numbers[0])]
    results = first + threads.map_in_threads(one, numbers[1:])
    free = FreeMotion(*map(np.stack, zip(*results, strict=True)))
    if not free.hours.sum() > 0:
        raise UserError(
            f"the robot is never live in {course.seconds} s of fault-free motion, or every run"
            " failed, so false alarms cannot be counted. Check the campaign without faults"
        )
    return FreeMotion(np.where((free.hours > 0)[..., None], free.peaks, 0.0), free.hours)


class Hazards(NamedTuple):
    """Runs whose fault evades the robot's checks, one run of each fault; arrays over runs."""

    group: np.ndarray  # str, name of the fault's group
    sampled: np.ndarray  # bool, True if the group draws its faults at random
    # Int, the independent unit: the fault, or the robot if whole robots were drawn.
    unit: np.ndarray
    robots: bool  # True if units are robots
    harm_ms: np.ndarray  # int, time of the harm
    # int [runs, candidates, margins], time from the first alarm to the harm; below 0 if there is no
    # alarm before the harm.
    lead_ms: np.ndarray

    @property
    def count(self) -> int:
        """Return the number of runs."""
        return len(self.harm_ms)

    def halves(self, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Divide the units of each group at random into a half for selection and one for the
        statement. Return both as bool [runs].
        """
        rng = np.random.default_rng([seed, 1])
        mine = np.zeros(self.count, bool)
        strata = (
            np.zeros(self.count, int)
            if self.robots
            else np.unique(self.group, return_inverse=True)[1]
        )
        odd = 0
        for stratum in range(strata.max(initial=-1) + 1):
            among = rng.permutation(np.unique(self.unit[strata == stratum]))
            mine |= (strata == stratum) & np.isin(self.unit, among[odd::2])
            # If groups have odd sizes, the larger half is in turn the first and the second.
            odd = (odd + len(among)) % 2
        return mine, ~mine

    def rate(self, hit: np.ndarray, rows: np.ndarray) -> Rate:
        """Return the share of `rows` (bool [runs]) that are in `hit` (bool [runs]).

        The interval is over faults, or over robots if whole robots were drawn.
        """
        if not self.robots:
            return wilson_interval(int(hit[rows].sum()), int(rows.sum()))
        return units.rate_band(hit[rows], units.group_units(self.unit[rows]))


NEVER = -(2**30)
"""Lead time of an alarm that was never raised."""


def run_hazards(
    raw: Mapping[str, Any],
    parts: Sequence[Candidate],
    margins: Sequence[float],
    folder: Path,
    engine: str,
    groups: Sequence[str],
    on_progress: OnProgress | None,
) -> Hazards:
    """Run the campaign with all candidates as detectors, and return its evading faults.

    Raise UserError if no fault evades.
    """
    config, prefixes = candidates.with_detectors(
        raw, candidates.detector_tables(parts, margins, folder)
    )
    results = runner.run_campaign(config, None, engine, on_progress=on_progress)
    rules = campaign_choices(config)
    names = schema.arrow_schema(results.shape).names
    watching = tuple(prefix for prefix in (*prefixes, *(f"golden_{prefix}" for prefix in prefixes)))
    needed = {name for name in names if name.startswith(watching) and not name.endswith("_alarms")}
    table = results.frame(
        [name for name in names if name in needed | {*facts.needed_columns(names, rules)}]
    )
    rows, harm = evading_faults(table, rules, groups)
    if not rows.any():
        among = f" of {', '.join(groups)}" if groups else ""
        raise UserError(
            f"no fault{among} evades the robot's checks with a motion of more than"
            f" {config.outcomes.limit_mm:g} mm: no further check is needed"
        )
    some = table.loc[rows]
    lead = np.stack([detector_leads(some, prefix, margins, harm) for prefix in prefixes], axis=1)
    group = some["group"].astype(str).to_numpy()
    robots = [name for name in drawn_robots.robot_columns(raw) if name in some]
    unit = some.groupby(robots, sort=False).ngroup().to_numpy() if robots else np.arange(len(some))
    random = draws.drawn_groups(raw) or frozenset()
    return Hazards(group, np.isin(group, list(random)), unit, bool(robots), harm, lead)


def detector_leads(
    table: pd.DataFrame, prefix: str, thresholds: Sequence[float], harm: np.ndarray
) -> np.ndarray:
    """Return the time from a detector's first alarm to the harm, ms [runs, thresholds].

    It is NEVER if there was no alarm, or if the golden run has an alarm too, because such an alarm
    does not show the fault.
    """
    golden = table[f"golden_{prefix}score"].to_numpy(np.float32)
    out = np.full((len(table), len(thresholds)), NEVER)
    for place, threshold in enumerate(thresholds):
        first = table[f"{prefix}threshold{place}_first_ms"].to_numpy(np.int64)
        fine = (first >= 0) & ~(golden > np.float32(threshold))
        out[fine, place] = (harm - first)[fine]
    return out


def evading_faults(
    table: pd.DataFrame, rules: facts.Choices, groups: Sequence[str]
) -> tuple[np.ndarray, np.ndarray]:
    """Return which rows are evading faults (bool [rows], one run of each fault), and the time of
    the harm of each of these, ms.
    """
    runs = facts.derive_facts(table, rules)
    rows = runs["sample"] & runs["faulty"] & runs["evaded"] & (runs["unintended_ms"] >= 0)
    if groups:
        rows &= table["group"].astype(str).isin(list(groups))
    return rows.to_numpy(bool), runs.loc[rows, "unintended_ms"].to_numpy(np.int64)


def campaign_choices(config: CampaignConfig) -> facts.Choices:
    """Return the campaign's settings on which the definitions of outcomes depend."""
    reaction = config.model_dump(mode="json").get("reaction") or {}
    action = ACTIONS.index(reaction.get("action", "release")) if config.reacts else 0
    return facts.Choices(config.rules, action, config.robot)
