"""Runs a campaign with all candidates as detectors, and measures each alarm's lead before harm."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.analyses.monitors.counterfactual import candidates
from ravenjax.analyses.monitors.counterfactual.candidates import Candidate
from ravenjax.campaign import runner
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.progress import OnProgress
from ravenjax.errors import UserError, suggest_name
from ravenjax.report.data import draws, facts
from ravenjax.report.sections import robots as drawn_robots
from ravenjax.stats.bootstrap import units
from ravenjax.stats.intervals import Rate, wilson_interval
from ravenjax.store import schema
from ravenjax.vocabulary.reactions import ACTIONS


class Hazards(NamedTuple):
    """Runs whose fault evades the robot's checks, one of each fault; arrays over runs in order."""

    group: np.ndarray  # str
    sampled: np.ndarray  # bool: the group draws its faults
    # Int, the sampled unit: the fault, or the robot if robots were drawn whole.
    unit: np.ndarray
    robots: bool  # True if units are robots
    harm_ms: np.ndarray  # int
    # int [runs, candidates, margins]: harm minus first alarm; below 0 if there is none before harm.
    lead_ms: np.ndarray

    @property
    def count(self) -> int:
        """Return the number of runs."""
        return len(self.harm_ms)

    def halves(self, seed: int) -> tuple[np.ndarray, np.ndarray]:
        """Return (selection, statement), bool rows: units halved at random, within their group."""
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
            # Alternates, so that groups of odd size do not all favour one half.
            odd = (odd + len(among)) % 2
        return mine, ~mine

    def rate(self, hit: np.ndarray, rows: np.ndarray) -> Rate:
        """Return the share of some rows, with an interval over faults, or over robots if drawn."""
        if not self.robots:
            return wilson_interval(int(hit[rows].sum()), int(rows.sum()))
        return units.rate_band(hit[rows], units.group_units(self.unit[rows]))


NEVER = -(2**30)
"""Lead of an alarm that never came."""


def run_hazards(
    raw: Mapping[str, Any],
    parts: Sequence[Candidate],
    margins: Sequence[float],
    folder: Path,
    engine: str,
    groups: Sequence[str] = (),
    on_progress: OnProgress | None = None,
) -> Hazards:
    """Compute the campaign and return its evading faults. Raises UserError if no fault evades."""
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
            f" {config.outcomes.limit_mm:g} mm: there is nothing that a further check would have"
            " to see"
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
    """Return harm minus first alarm, ms [runs, thresholds], of a detector.

    It is NEVER if no alarm came, or if the golden run has one too, because such an alarm is no sign
    of the fault.
    """
    golden = table[f"golden_{prefix}score"].to_numpy(np.float32)
    out = np.full((len(table), len(thresholds)), NEVER)
    for place, threshold in enumerate(thresholds):
        first = table[f"{prefix}threshold{place}_first_ms"].to_numpy(np.int64)
        fine = (first >= 0) & ~(golden > np.float32(threshold))
        out[fine, place] = (harm - first)[fine]
    return out


def evading_faults(
    table: pd.DataFrame, rules: facts.Choices, groups: Sequence[str] = ()
) -> tuple[np.ndarray, np.ndarray]:
    """Return which rows are evading faults, one of each (bool), and when each harm began, ms."""
    runs = facts.derive_facts(table, rules)
    rows = runs["sample"] & runs["faulty"] & runs["evaded"] & (runs["unintended_ms"] >= 0)
    if groups:
        rows &= table["group"].astype(str).isin(list(groups))
    return rows.to_numpy(bool), runs.loc[rows, "unintended_ms"].to_numpy(np.int64)


def campaign_choices(config: CampaignConfig) -> facts.Choices:
    """Return the campaign's choices in the definitions of outcomes."""
    reaction = config.model_dump(mode="json").get("reaction") or {}
    action = ACTIONS.index(reaction.get("action", "release")) if config.reacts else 0
    return facts.Choices(config.rules, action, config.robot)


def require_groups(config: CampaignConfig, groups: Sequence[str]) -> None:
    """Raise UserError for a group that the campaign lacks."""
    names = [group.name for group in config.group]
    for name in groups:
        if name not in names:
            raise UserError(
                f"--group {name!r}: unknown, expected {', '.join(names)}{suggest_name(name, names)}"
            )
