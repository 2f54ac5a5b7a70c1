"""Every haptic threshold and gain on the same runs: hazards that it misses against cues for nothing.

A hazard is missed where a harmful run had no cue, or one that its fault-free twin had by then, too: such a cue tells of
the motion and not of the fault. A false cue is one in fault-free motion. Rates are of one run of each fault.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import NamedTuple

import pandas as pd

from ravenjax.report import counted, tables
from ravenjax.report.facts import FACTS
from ravenjax.report.runs import HARMFUL, Runs, after_onset
from ravenjax.stats.false_alarms import AlarmRate, alarm_rate
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.pareto import front
from ravenjax.store.manifest import Cue, Manifest
from ravenjax.store.query import RESULTS

COST_RATIOS = (1, 10, 100, 1000)
"""How many false cues a missed hazard weighs, where harmful and fault-free runs come equally often."""
FELT = ("peak_force", "ms", "count")
"""What is told of a cue that is felt, by the ends of its columns."""
MOST = 500_000
"""Harmful runs that the medians of what is felt are of; of more, about so many are drawn."""
FALSE_PER_HOUR = (0.5, 1, 10, 60)
HARMLESS = "sample AND faulty AND NOT harm"


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


def rows(runs: Runs, manifest: Manifest) -> list[Row]:
    """One row a haptic set, by threshold and gain."""
    free = runs.motions()
    felt = runs.counts([f"warned{k}_ms >= 0" for k in range(len(manifest.cues))], where=HARMLESS)
    harmless = runs.count(HARMLESS)
    drawn = _felt(runs, len(manifest.cues))
    made = []
    for k, cue in enumerate(manifest.cues):
        event, end = after_onset(f"warned{k}_ms"), str(manifest.duration_ms)
        delay, lags = (runs.delays(event, start, end, HARMFUL)[""] for start in ("active_ms", "harm_ms"))
        lead = counted.lead(lags)
        false = tables.rate_of(free.came(f"twin_cue{k}_first_ms"), free.count)
        when = (drawn[f"warned{k}_ms"] >= drawn["active_ms"]) & (drawn[f"warned{k}_ms"] >= 0)
        made.append(
            Row(
                k,
                cue,
                tables.rate_of(lead.n - lead.alarmed, lead.n),
                false,
                alarm_rate(false.k, free.hours) if free.hours else None,
                tables.rate_of(felt[k], harmless),
                False,
                counted.incidence(delay).quantile_interval(0.5),
                lead.before,
                lead.quantile(0.5),
                *(_median(drawn.loc[when, f"cue{k}_{what}"]) for what in FELT),
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


def _felt(runs: Runs, cues: int) -> pd.DataFrame:
    """Of harmful runs what was felt of each cue, and when."""
    numbers = range(cues)
    felt = [f"{RESULTS}.cue{k}_{what}" for k in numbers for what in FELT]
    return runs.drawn(", ".join([f"{FACTS}.active_ms", *(f"warned{k}_ms" for k in numbers), *felt]), HARMFUL, MOST)


def _median(values: pd.Series) -> float:
    return float(values.median()) if len(values) else math.nan
