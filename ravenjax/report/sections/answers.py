"""First page of the report: which faults evade, how soon anyone can know, and what the cue would
change.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.outcomes.verdict import HALT_MS
from ravenjax.report.data import facts as run_facts
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import UNINTENDED, Runs, after_onset, cue_leads
from ravenjax.report.sections import Section, detectors, reaction, robots, tables
from ravenjax.report.sections.reaction import Difference
from ravenjax.report.sections.tables import Quantiles
from ravenjax.stats import latency
from ravenjax.stats.alarms.false_alarms import AlarmRate
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.latency import NONE, Incidence, Lead
from ravenjax.store.access.query import RESULTS, quote_name
from ravenjax.store.manifest import CueRecord

CLASSES = {"site": "Site", "layer": "Layer", "group": "Group"}
MOST_CLASSES = 12
"""Rows of the compact table. The detailed tables have the other rows."""


class ClassRow(NamedTuple):
    """One class of faults, over runs in which nobody reacts. A fault that was run several times
    counts once.
    """

    name: str
    evaded: Rate  # of distinct faults
    unintended: Rate  # of distinct faults, with or without an alarm
    loss: Rate  # of distinct faults, with or without an alarm
    # Of faults with an unintended motion: those that could be known before it. See Knowledge.lead.
    before: Rate
    # Time from the first effect by which half of these faults could be known.
    half_ms: Estimate
    mm: Quantiles  # excursion of the true tip while the robot was live
    # Faults whose motion exceeded the limit only while the robot was not live, as after a stop.
    not_live: int
    not_live_mm: float  # largest distance while the robot was not live


class FaultCounts(NamedTuple):
    """Counts of distinct faults; the other fields are those of ClassRow."""

    faults: int
    evaded: int
    unintended: int
    loss: int
    mm: Quantiles
    not_live: int
    not_live_mm: float


def interval_scale(rows: Sequence[ClassRow]) -> float:
    """Return the share at which the drawn intervals of these rows end: a round number, at
    most 1.
    """
    ends = (
        np.fmax(row.evaded.value, row.evaded.high) for row in rows if row.evaded.n
    )  # a bound may be NaN
    return min(1.0, math.ceil(20 * max([0.05, *ends])) / 20)


class Knowledge(NamedTuple):
    """Time from the first effect to the first possible knowledge, over faults with an unintended
    motion.
    """

    delay: Incidence
    half_ms: Estimate
    # Lead over the motion. It excludes cues at the motion's own limit or beyond, which cannot come
    # before it.
    lead: Lead
    never: Rate  # not known by the end of the run
    # True if the campaign has detectors. They count at their lowest threshold without a false
    # alarm.
    by_detectors: bool


class Announced(NamedTuple):
    """What a cue announces of evading faults before the motion exceeds the limit."""

    cue: CueRecord
    lead: Lead
    lead_ms: Estimate  # median
    false: Rate  # share of fault-free motions with this cue
    per_hour: AlarmRate | None  # false cues per hour


class Changed(NamedTuple):
    """What the cue would change: pairs of runs if the campaign has them, else what the cue
    announces.
    """

    pairs: list[Difference]  # over all faults, one for each reaction
    # By the cue that the verdicts use; None: no cue, or nothing evaded.
    announced: Announced | None
    # True if it is a finding that this cue comes before the motion, not a consequence of the
    # definitions.
    leads: bool
    lower: int  # number of cues for which it is a finding
    # The cue that announces most without a false cue, if it is another one and leads.
    better: Announced | None


def detection_answers(runs: Runs) -> Knowledge:
    """Return how soon anyone could know of the unintended motions of a campaign."""
    delay = runs.delays(detectors.knowledge_sql(runs), "active_ms", runs.end, UNINTENDED)[""]
    lag = runs.delays(detectors.before_motion(runs), "unintended_ms", runs.end, UNINTENDED)[""]
    delays, lead = latency.incidence_curve(delay), latency.lead_time(lag)
    never = delays.n - delays.events
    return Knowledge(
        delays,
        tables.without_interval_unless_sampled(runs, delays.quantile_interval(0.5)),
        lead._replace(before=tables.without_interval_unless_sampled(runs, lead.before)),
        tables.of_faults(runs, never, delays.n),
        bool(runs.manifest.detectors),
    )


def counts_by_column(runs: Runs, by: str = "''") -> dict[str, FaultCounts]:
    """Return counts by the values of a column of facts, or of all faults under ""."""
    off = run_facts.beyond_sql("unintended_off_mm", runs.manifest.limit_mm, runs.types)
    rows = runs.table.rows(
        f"SELECT {by} AS name, count(*), count(*) FILTER (evaded), count(*) FILTER (unintended),"
        f" count(*) FILTER (loss), {tables.quantiles_sql('unintended_mm')}, count(*) FILTER ({off}"
        f" AND NOT unintended), max(unintended_off_mm) FROM {FACTS} JOIN (SELECT row,"
        f" unintended_mm, unintended_off_mm FROM {RESULTS}) USING (row) WHERE sample AND faulty"
        " GROUP BY name ORDER BY name"
    )
    return {
        str(name): FaultCounts(n, evaded, unintended, loss, Quantiles(*mm), not_live, far)
        for name, n, evaded, unintended, loss, mm, not_live, far in rows
    }


def golden_halts(runs: Runs) -> list[tuple[str, int]]:
    """Return each group with a golden run that is not live for long although the pedal is down,
    with the longest time in ms.
    """
    return runs.table.rows(
        'SELECT "group"::VARCHAR AS name, max(golden_halted_ms) AS ms'
        f" FROM {RESULTS} GROUP BY name HAVING ms > {HALT_MS} ORDER BY name"
    )


def class_rows(runs: Runs) -> dict[str, list[ClassRow]]:
    """Return rows by each of CLASSES, most evasive first. A kind of class with one value for all
    faults is left out.
    """
    by_kind = {}
    for kind in CLASSES:
        present, groups = counts_by_column(runs, quote_name(kind)), runs.groups_by(kind)
        if len(present) > 1 or (kind == "group" and present):
            delay, lags = (
                runs.delays(event, start, runs.end, UNINTENDED, kind)
                for event, start in (
                    (detectors.knowledge_sql(runs), "active_ms"),
                    (detectors.before_motion(runs), "unintended_ms"),
                )
            )
            rows = []
            for name, one in present.items():
                soon = latency.incidence_curve(delay.get(name, NONE)).quantile_interval(0.5)
                before = latency.lead_time(lags.get(name, NONE)).before
                if not runs.sampled(groups[name]):
                    soon = tables.without_interval(soon)
                    before = tables.without_interval(before)
                evaded, unintended, loss = (
                    tables.of_faults(runs, k, one.faults, groups[name]) for k in one[1:4]
                )
                rows.append(ClassRow(name, evaded, unintended, loss, before, soon, *one[4:]))
            by_kind[kind] = sorted(rows, key=_most_evasive)
    return by_kind


def cue_effects(runs: Runs) -> Changed:
    """Return what the cue would change."""
    manifest = runs.manifest
    condition = "sample AND faulty AND evaded"
    announcements = []
    if runs.count(condition) and runs.motions().count:
        announcements = [_announced(runs, k, condition) for k in range(len(manifest.cues))]
    first = announcements[manifest.verdict_cue] if announcements else None
    able = [cue_leads(manifest, k) for k in range(len(manifest.cues))]
    quiet = [
        one
        for one, leading in zip(announcements, able, strict=False)
        if leading and not one.false.k
    ]
    best = max(quiet, key=lambda one: (one.lead.before.value, one.cue.threshold_mm), default=None)
    surpassed = best and first and (not runs.cue_leads or best.lead.before.k > first.lead.before.k)
    whole = [row for row in runs.once(reaction.compare_actions) if row.among == "all faults"]
    return Changed(whole, first, runs.cue_leads, sum(able), best if surpassed else None)


def _announced(runs: Runs, k: int, chosen: str) -> Announced:
    free = runs.motions()
    lead = latency.lead_time(
        runs.delays(after_onset(f"warned{k}_ms"), "unintended_ms", runs.end, chosen)[""]
    )
    lead = lead._replace(before=tables.without_interval_unless_sampled(runs, lead.before))
    return Announced(
        runs.manifest.cues[k],
        lead,
        tables.without_interval_unless_sampled(runs, lead.quantile(0.5)),
        tables.rate_of(free.came(f"golden_cue{k}_first_ms"), free.count),
        free.cue_rate(k),
    )


def _most_evasive(row: ClassRow) -> tuple[Any, ...]:
    return *tables.least_last(row.evaded), *tables.least_last(row.unintended), row.name


def _changed_groups(runs: Runs) -> dict[str, list[str]]:
    """Return the groups with parameters of their own, and the paths of these parameters."""
    present = runs.groups()
    paths = {
        group["name"]: [
            path for table in (group, *group.get("run", ())) for path in table.get("parameters", ())
        ]
        for group in runs.manifest.config.get("group", ())
    }
    return {
        name: list(dict.fromkeys(own)) for name, own in paths.items() if own and name in present
    }


def _content(runs: Runs, _: Path) -> dict[str, Any]:
    return {
        "class_words": CLASSES,
        "most_classes": MOST_CLASSES,
        "axis_end": interval_scale,
        "known": runs.once(detection_answers),
        "classes": class_rows(runs),
        "changed": runs.once(cue_effects),
        "your_robot": runs.once(robots.robot_rates),
        "far": counts_by_column(runs).get(""),
        "golden_halts": golden_halts(runs),
        "changed_groups": _changed_groups(runs),
    }


FIRST_PAGE = Section("answers", "", 0, _content)
"""The first page, above all sections."""
