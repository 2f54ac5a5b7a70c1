"""The set as real detectors in a campaign of its own: what they detect, beside what was
promised.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.analyses.monitors.counterfactual import hazards
from ravenjax.analyses.monitors.counterfactual.finding import Counterfactual
from ravenjax.campaign import loading, runner
from ravenjax.campaign.file.config import CampaignConfig
from ravenjax.campaign.progress.counts import OnProgress
from ravenjax.report import wording
from ravenjax.report.data import draws
from ravenjax.stats.intervals import Estimate, Rate, rate_difference, wilson


class Confirmation(NamedTuple):
    """What the detectors of `chosen/campaign.toml` saw in a run with other random numbers."""

    seed: int
    every: Rate  # of all faults that evade
    anew: Rate  # of those of groups that draw their faults
    promised: Rate  # of those of these groups in the statement half
    draws: bool  # whether any group draws its faults
    difference: Estimate  # of the two; without an interval where robots were drawn, or no faults

    @property
    def verdict(self) -> str:
        """as, more than, less than: the promise; "" where nothing can be told."""
        if math.isnan(self.difference.low):
            return ""
        if self.difference.low > 0:
            return "more than"
        return "less than" if self.difference.high < 0 else "as"

    @property
    def sentence(self) -> str:
        """In words."""
        start = (
            f"Run as detectors of their own with seed {self.seed}, the checks see {self.every.k} of"
            f" {self.every.n} faults in time ({wording.percent(self.every.value)})"
        )
        if not self.anew.n and self.draws:
            return f"{start}; none of these is of a group that draws its faults."
        if not self.anew.n:
            return f"{start}; no fault of this campaign is drawn, so they are the same faults."
        among = (
            f"of those drawn anew {self.anew.k} of {self.anew.n}, of those drawn before that state "
            f"{self.promised.k} of {self.promised.n}"
        )
        words = wording.point_bounds(self.difference)
        verdict = f" ({words} points): {self.verdict} promised" if self.verdict else ""
        return f"{start}; {among}{verdict}."


def run(
    one: Counterfactual,
    file: Path,
    seed: int,
    engine: str = "auto",
    on_progress: OnProgress | None = None,
) -> Confirmation:
    """Run the campaign that `output` wrote, with another seed. Raises UserError as a campaign
    does.
    """
    config = loading.load(file, [f"campaign.seed={seed}"])
    table = runner.run_campaign(config, None, engine, on_progress=on_progress).frame()
    rules = hazards.choices(config)
    rows = hazards.evading(table, rules, one.question.groups)
    hit = detected(
        table.loc[rows], hazards.harm_of(table, rules)[rows], config, len(one.promise.members)
    )
    in_time = hit >= one.question.lead_ms
    sampled = list(draws.groups(config.model_dump(mode="json")) or ())
    new = table.loc[rows, "group"].astype(str).isin(sampled).to_numpy()
    anew, promised = _rate(in_time[new]), _rate(_promised(one))
    gap = rate_difference(anew.k, anew.n, promised.k, promised.n)
    if one.grounds.hazards.robots:
        gap = Estimate(gap.value, math.nan, math.nan)
    return Confirmation(seed, _rate(in_time), anew, promised, bool(sampled), gap)


def _promised(one: Counterfactual) -> np.ndarray:
    """Which of the statement's faults that were drawn the set covers."""
    rows = one.grounds.statement_half & one.grounds.hazards.sampled
    return (
        one.grounds.leads(one.promise.members, one.promise.margin.place)[rows]
        >= one.question.lead_ms
    )


def detected(
    table: pd.DataFrame, harm: np.ndarray, config: CampaignConfig, members: int
) -> np.ndarray:
    """Harm minus the first alarm of the last `members` detectors of a campaign, ms [runs]."""
    first = len(config.detectors) - members
    each: Sequence[np.ndarray] = [
        hazards.leads(table, f"detector{first + place}_", config.detectors[first + place][2], harm)[
            :, 0
        ]
        for place in range(members)
    ]
    return np.max(each, axis=0)


def _rate(hit: np.ndarray) -> Rate:
    return wilson(int(hit.sum()), len(hit))
