"""Every haptic threshold and gain on the same runs: hazards that it misses against cues for
nothing.

A hazard, an unintended motion, is missed where its run had no cue, or one that the golden run had
by then, too: such a cue tells of the motion and not of the fault. A false cue is the first one of a
fault-free motion. Rates are of one run of each fault.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import pandas as pd

from ravenjax.report.data import counted, leads
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import UNINTENDED, Runs, after_onset, end_of
from ravenjax.report.sections import tables
from ravenjax.stats.alarms.false_alarms import AlarmRate
from ravenjax.stats.alarms.pareto import front
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.store.access.query import RESULTS
from ravenjax.store.manifest import CueRecord, Manifest

FELT = ("peak_force", "ms", "count")
"""What is told of a cue that is felt, by the ends of its columns."""
MOST = 500_000
"""Runs that the medians of what is felt are of; of more, about so many are drawn."""
HARMLESS = "sample AND faulty AND NOT unintended"


class CueRow(NamedTuple):
    """One haptic set."""

    number: int
    cue: CueRecord
    missed: Rate  # of runs with an unintended motion
    false: Rate  # of fault-free motions
    per_hour: AlarmRate | None
    # of faulty runs without an unintended motion, those with a cue that the golden run has not
    harmless: Rate
    best: bool  # no other set misses and disturbs as little
    # whether it is a finding that it comes before the motion, and no matter of definitions
    leads: bool
    delay_ms: Estimate  # median over those, from the fault's first effect
    before: Rate  # of runs with an unintended motion, those with the cue before it
    lead_ms: Estimate  # median over those
    force: float  # median of the largest force where felt in those, device units; NaN: never felt
    felt_ms: float  # median of the time with force there, ms
    pulses: float  # median number of pulses there

    @property
    def told(self) -> str:
        """The set in words."""
        return (
            f"{self.cue.threshold_mm:g} mm, Kp {self.cue.kp_per_mm:g}, Kd {self.cue.kd_s_per_mm:g}"
        )


def rows(runs: Runs, manifest: Manifest) -> list[CueRow]:
    """One row a haptic set, by threshold and gain; intervals where all faults were drawn."""
    free = runs.motions()
    felt = runs.counts([f"warned{k}_ms >= 0" for k in range(len(manifest.cues))], where=HARMLESS)
    harmless = runs.count(HARMLESS)
    sample = _felt(runs, len(manifest.cues))
    sampled = runs.sampled()
    result = []
    for k, cue in enumerate(manifest.cues):
        event, end = after_onset(f"warned{k}_ms"), end_of(manifest)
        delay, lags = (
            runs.delays(event, start, end, UNINTENDED)[""]
            for start in ("active_ms", "unintended_ms")
        )
        lead = counted.lead(lags)
        false = tables.rate_of(free.came(f"golden_cue{k}_first_ms"), free.count)
        when = (sample[f"warned{k}_ms"] >= sample["active_ms"]) & (sample[f"warned{k}_ms"] >= 0)
        result.append(
            CueRow(
                k,
                cue,
                tables.of_faults(runs, lead.n - lead.alarmed, lead.n),
                false,
                free.cue_rate(k),
                tables.of_faults(runs, felt[k], harmless),
                False,
                leads.cue(manifest, k),
                tables.known(counted.incidence(delay).quantile_interval(0.5), sampled),
                tables.known(lead.before, sampled),
                tables.known(lead.quantile(0.5), sampled),
                *(_median(sample.loc[when, f"cue{k}_{what}"]) for what in FELT),
            )
        )
    best = front(
        [row.missed.value for row in result],
        [row.per_hour.per_hour if row.per_hour else 0.0 for row in result],
    )
    result = [row._replace(best=bool(is_best)) for row, is_best in zip(result, best, strict=True)]
    return sorted(
        result, key=lambda row: (row.cue.threshold_mm, row.cue.kp_per_mm, row.cue.kd_s_per_mm)
    )


def _felt(runs: Runs, cues: int) -> pd.DataFrame:
    """Of runs with an unintended motion what was felt of each cue, and when."""
    numbers = range(cues)
    felt = [f"{RESULTS}.cue{k}_{what}" for k in numbers for what in FELT]
    return runs.drawn(
        ", ".join([f"{FACTS}.active_ms", *(f"warned{k}_ms" for k in numbers), *felt]),
        UNINTENDED,
        MOST,
    )


def _median(values: pd.Series) -> float:
    return float(values.median()) if len(values) else math.nan
