"""First page of the report: faults that evade, how soon people notice, and what a cue changes."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.outcomes.verdict import HALT_MS
from ravenjax.report.data import facts as run_facts
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import DISTINCT_FAULTS, UNINTENDED, Runs, after_onset
from ravenjax.report.sections import Section, detectors, reaction, robots, tables
from ravenjax.report.sections.reaction import Difference
from ravenjax.report.sections.tables import EventTimes, Quantiles
from ravenjax.stats import latency
from ravenjax.stats.alarms.false_alarms import AlarmRate
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.latency import NO_DELAYS
from ravenjax.store.access.query import RESULTS, quote_name
from ravenjax.store.manifest import CueRecord

CLASSES = {"site": "Site", "layer": "Layer", "group": "Group"}
MOST_CLASSES = 12
"""Rows of the compact table. The detailed tables have the other rows."""


class ClassRow(NamedTuple):
    """One class of faults, over runs in which nobody reacts. Each fault counts once."""

    name: str
    evaded: Rate  # of distinct faults
    unintended: Rate  # of distinct faults, with or without an alarm
    loss: Rate  # of distinct faults, with or without an alarm
    # Share of faults with an unintended motion that a cue, check or detector reported before the
    # motion, as in `detectors.knowledge_sql`.
    before: Rate
    half_ms: Estimate  # time from the first effect until half of these faults were reported
    mm: Quantiles  # excursion of the true tip while the robot was live
    not_live: int  # faults whose motion exceeded the limit only while the robot was not live
    not_live_mm: float  # largest distance while the robot was not live


def interval_scale(rows: Sequence[ClassRow]) -> float:
    """Return the end of the axis for drawn intervals: a multiple of 0.05, at most 1."""
    # A rate without an interval has the bound NaN, which `fmax` ignores.
    ends = (np.fmax(row.evaded.value, row.evaded.high) for row in rows if row.evaded.n)
    return min(1.0, math.ceil(20 * max([0.05, *ends])) / 20)


class Announced(NamedTuple):
    """How early one haptic set's cue comes in runs whose fault evades, and its false cues."""

    cue: CueRecord
    times: EventTimes  # of the cue
    false: Rate  # share of fault-free motions with this cue
    per_hour: AlarmRate | None  # false cues per hour


class Changed(NamedTuple):
    """Effect of the cue: comparisons of runs with and without a reaction, and the cue's lead."""

    pairs: list[Difference]  # over all faults, one for each reaction
    announced: Announced | None  # lead of the verdicts' cue; None: no cue, or no fault evaded
    # The haptic set that warns of most motions without a false cue, if better than the verdicts'.
    better: Announced | None


def detection_answers(runs: Runs) -> EventTimes:
    """Return when the cue, a check or a detector first reported each unintended motion.

    Detectors count at their lowest threshold without a false alarm.
    """
    return tables.event_times(runs, detectors.knowledge_sql(runs))


def golden_halts(runs: Runs) -> list[tuple[str, int]]:
    """Return (group, longest halt in ms) for groups whose golden runs halt with the pedal down.

    Halts of up to HALT_MS are left out.
    """
    return runs.table.rows(
        'SELECT "group"::VARCHAR AS name, max(golden_halted_ms) AS ms'
        f" FROM {RESULTS} GROUP BY name HAVING ms > {HALT_MS} ORDER BY name"
    )


def class_rows(runs: Runs, kind: str = "") -> list[ClassRow]:
    """Return a row for each value of the column `kind` of facts, those that evade most first.

    Without a column, the only row is for all faults.
    """
    is_beyond = run_facts.beyond_sql("unintended_off_mm", runs.manifest.limit_mm, runs.types)
    # The first report of each unintended motion: delay from the fault, lag from the motion.
    delays, lags = (
        runs.delays(detectors.knowledge_sql(runs), start, runs.end, UNINTENDED, kind or None)
        for start in ("active_ms", "unintended_ms")
    )
    # `class_counts` puts the value of `kind`, the groups and the number of faults before these. The
    # last two are excursions while the robot was not live (column unintended_off_mm).
    columns = (
        *(f"count(*) FILTER ({event})" for event in ("evaded", "unintended", "loss")),
        tables.quantiles_sql("unintended_mm"),
        f"count(*) FILTER ({is_beyond} AND NOT unintended)",
        "max(unintended_off_mm)",
    )
    by = f"{FACTS}.{quote_name(kind)}::VARCHAR" if kind else "''"
    rows = []
    for name, groups, n, *counts, mm, beyond, off_mm in tables.class_counts(runs, by, columns):
        half_ms = latency.incidence_curve(delays.get(name, NO_DELAYS)).quantile_interval(0.5)
        before = latency.rate_before(lags.get(name, NO_DELAYS))
        if not runs.sampled(groups):
            half_ms, before = tables.without_interval(half_ms), tables.without_interval(before)
        evaded, unintended, loss = (tables.fault_share(runs, k, n, groups) for k in counts)
        rates = evaded, unintended, loss, before
        rows.append(ClassRow(name, *rates, half_ms, Quantiles(*mm), beyond, off_mm))
    return sorted(rows, key=lambda row: [*map(tables.rate_order, (row.evaded, row.unintended))])


def cue_effects(runs: Runs) -> Changed:
    """Return the effect of the cue, and of a better haptic set without a false cue, if any."""
    condition = f"{DISTINCT_FAULTS} AND evaded"
    announcements = []
    if runs.count(condition) and runs.motions.count:
        announcements = [_announced(runs, k, condition) for k in range(len(runs.manifest.cues))]
    used = announcements[runs.manifest.verdict_cue] if announcements else None
    quiet = [cue for cue in announcements if not cue.false.k]
    # The best set has the largest share of motions with the cue before the motion (times.before).
    best = max(quiet, key=lambda cue: (cue.times.before, cue.cue.threshold_mm), default=None)
    better = best and used and best.times.before > used.times.before
    comparisons = [row for row in runs.once(reaction.compare_actions) if row.among == "all faults"]
    return Changed(comparisons, used, best if better else None)


def _announced(runs: Runs, k: int, condition: str) -> Announced:
    # Computes how early the cue of haptic set `k` comes, and how often it comes without a fault.
    motions = runs.motions
    return Announced(
        runs.manifest.cues[k],
        tables.event_times(runs, after_onset(f"warned{k}_ms"), where=condition),
        tables.wilson_share(motions.count_with_event(f"golden_cue{k}_first_ms"), motions.count),
        motions.cue_rate(k),
    )


def _parameters_by_group(runs: Runs):
    # Returns group -> paths of the parameters that the group's table, or its tables of runs, set.
    # Groups that set none are left out.
    paths: dict[str, list[str]] = {}
    for group in runs.manifest.config.get("group", ()):
        tables_of_group = (group, *group.get("run", ()))
        names = [path for table in tables_of_group for path in table.get("parameters", ())]
        paths[group["name"]] = list(dict.fromkeys(names))
    return {name: paths[name] for name in runs.groups() if paths.get(name)}


def _content(runs: Runs, _: Path):
    # Returns the variables of the template answers.html.j2.
    return {
        "class_words": CLASSES,
        "most_classes": MOST_CLASSES,
        "axis_end": interval_scale,
        "known": runs.once(detection_answers),
        "halt_ms": HALT_MS,
        "classes": {
            kind: rows
            for kind in CLASSES
            if len(rows := class_rows(runs, kind)) > 1 or (kind == "group" and rows)
        },
        "changed": cue_effects(runs),
        "your_robot": runs.once(robots.robot_rates),
        "all_faults": next(iter(class_rows(runs)), None),
        "golden_halts": golden_halts(runs),
        "changed_groups": _parameters_by_group(runs),
    }


FIRST_PAGE = Section("answers", "", _content)
"""The first page, above all sections."""
