"""Every haptic threshold and gain on the same runs: hazards that it misses against cues for nothing.

A hazard is missed where a harmful run had no cue, or one that its fault-free twin had by then, too: such a cue tells of
the motion and not of the fault. A false cue is one in fault-free motion. Rates are of one run of each fault.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report import facts as run_facts
from ravenjax.report import tables
from ravenjax.stats.false_alarms import AlarmRate, alarm_rate
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.latency import incidence, lead_time
from ravenjax.stats.pareto import front
from ravenjax.store.manifest import Cue, Manifest

COST_RATIOS = (1, 10, 100, 1000)
"""How many false cues a missed hazard weighs, where harmful and fault-free runs come equally often."""
FELT = ("peak_force", "ms", "count")
"""What is told of a cue that is felt, by the ends of its columns."""
FALSE_PER_HOUR = (0.5, 1, 10, 60)


class Row(NamedTuple):
    """One haptic set."""

    number: int
    cue: Cue
    missed: Rate  # of harmful runs
    false: Rate  # of fault-free motions
    per_hour: AlarmRate | None
    harmless: Rate  # of faulty runs without harm, those with a cue that the twin has not
    best: bool  # no other set misses and disturbs as little
    delay_ms: Estimate  # median over harmful runs, from the fault's first effect
    before: Rate  # of harmful runs, those with the cue before the harm
    lead_ms: Estimate  # median over harmful runs
    force: float  # median of the largest force where felt in harmful runs, device units; NaN: never felt
    felt_ms: float  # median of the time with force there, ms
    pulses: float  # median number of pulses there

    @property
    def told(self) -> str:
        """The set in words."""
        return f"{self.cue.threshold_mm:g} mm, Kp {self.cue.kp_per_mm:g}, Kd {self.cue.kd_s_per_mm:g}"


class Choice(NamedTuple):
    """What the data choose under one rule: the set and others that do exactly as well."""

    rule: str
    row: Row | None  # None: no set keeps the rule
    alike: int


def rows(frame: pd.DataFrame, facts: pd.DataFrame, manifest: Manifest) -> list[Row]:
    """One row a haptic set, by threshold and gain."""
    free = run_facts.motions(frame, facts)
    hours = run_facts.hours(free)
    sample = facts["sample"].to_numpy()
    harmful = (facts["sample"] & facts["harm"] & facts["faulty"] & facts["activated"]).to_numpy()
    harmless = sample & ~facts["harm"].to_numpy() & facts["faulty"].to_numpy()
    active, harm = (facts.loc[harmful, name].to_numpy(float) for name in ("active_ms", "harm_ms"))
    made = []
    for k, cue in enumerate(manifest.cues):
        warned = run_facts.warned(frame, k)
        first = np.where(warned[harmful] >= 0, warned[harmful], np.nan).astype(float)
        first[first < active] = np.nan
        came = ~np.isnan(first)
        false = tables.rate(run_facts.first_came(free, f"twin_cue{k}_first_ms"))
        lead = lead_time(first, harm, float(manifest.duration_ms))
        felt = frame.loc[harmful, [f"cue{k}_{what}" for what in FELT]].loc[came]
        made.append(
            Row(
                k,
                cue,
                tables.rate(~came),
                false,
                alarm_rate(false.k, hours) if hours else None,
                tables.rate(warned[harmless] >= 0),
                False,
                incidence(np.where(came, first, manifest.duration_ms) - active, came).quantile_interval(0.5),
                lead.before,
                lead.quantile(0.5),
                *(_median(felt[name]) for name in felt),
            )
        )
    best = front([row.missed.value for row in made], [row.false.value for row in made])
    made = [row._replace(best=bool(is_best)) for row, is_best in zip(made, best, strict=True)]
    return sorted(made, key=lambda row: (row.cue.threshold_mm, row.cue.kp_per_mm, row.cue.kd_s_per_mm))


def choices(made: Sequence[Row]) -> list[Choice]:
    """What the data choose for each of COST_RATIOS and of FALSE_PER_HOUR, neighbours with the same choice in one; none
    without harmful or fault-free runs."""
    able = [row for row in made if row.missed.n and row.per_hour is not None]
    if not able:
        return []
    weighed = [(f"{ratio:,}", _choice(able, _cost(able, ratio))) for ratio in COST_RATIOS]
    kept = [(most, [row for row in able if row.per_hour and row.per_hour.per_hour <= most]) for most in FALSE_PER_HOUR]
    rare = [(f"{most:g}", _choice(rows, [row.missed.value for row in rows])) for most, rows in kept]
    return [
        *_joined("a missed hazard weighs as much as {} false cues", weighed),
        *_joined("at most {} false cues an hour", rare),
    ]


def _cost(rows: Sequence[Row], ratio: float) -> list[float]:
    return [ratio * row.missed.value + row.false.value for row in rows]


def _choice(among: Sequence[Row], cost: Sequence[float]) -> tuple[Row | None, int]:
    """The cheapest, and how many others do exactly as well; of equals that with fewer false cues, then the higher
    threshold."""
    if not among:
        return None, 0
    order = sorted(range(len(among)), key=lambda i: (cost[i], among[i].false.value, -among[i].cue.threshold_mm))
    first = among[order[0]]
    same = [row for row in among if (row.missed, row.false) == (first.missed, first.false)]
    return first, len(same) - 1


def _joined(rule: str, found: Sequence[tuple[str, tuple[Row | None, int]]]) -> list[Choice]:
    """One choice for neighbours that agree."""
    made = []
    for _, group in itertools.groupby(found, key=lambda one: one[1][0] and one[1][0].number):
        same = list(group)
        numbers = same[0][0] if len(same) == 1 else f"{same[0][0]} to {same[-1][0]}"
        made.append(Choice(rule.format(numbers), *same[0][1]))
    return made


def _median(values: pd.Series) -> float:
    return float(values.median()) if len(values) else math.nan
