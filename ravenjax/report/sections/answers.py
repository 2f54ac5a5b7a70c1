"""The first page: which faults evade, how long before anyone can know, what the cue would
change.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.document import ticks
from ravenjax.report.data import counted, leads
from ravenjax.report.data.counted import NONE, Delays
from ravenjax.report.data.facts import first_sql
from ravenjax.report.data.runs import UNINTENDED, FaultCounts, Runs, after_onset, end_of
from ravenjax.report.sections import tables
from ravenjax.report.sections.reaction.pairs import Difference
from ravenjax.stats.alarms.false_alarms import AlarmRate
from ravenjax.stats.intervals import Estimate, Rate
from ravenjax.stats.latency import Incidence, Lead
from ravenjax.store.manifest import CueRecord, Manifest

CLASSES = {"layer": "Layer", "site": "Site", "group": "Group"}
MOST_CLASSES = 12
"""Rows of the compact table; the rest stand in the evidence."""


class ClassRow(NamedTuple):
    """One class of faults, of runs in which nobody reacts; a fault that was run several times
    counts once.
    """

    name: str
    evaded: Rate  # of distinct faults
    unintended: Rate  # of distinct faults, whatever the checks did
    loss: Rate  # of distinct faults, whatever the checks did
    # of faults with an unintended motion, those that could be known before it; see Knowledge.lead
    before: Rate
    half_ms: Estimate  # time from the first effect by which half of those could be known


def scale(rows: Sequence[ClassRow]) -> float:
    """The share at which the drawn intervals of these rows end: a round one, at most 1."""
    ends = (
        np.fmax(row.evaded.value, row.evaded.high) for row in rows if row.evaded.n
    )  # a bound may be unknown
    return min(1.0, ticks.above(max([0.05, *ends])))


class LowerCue(NamedTuple):
    """What a cue of a smaller distance than the motion's would tell before it, beside checks and
    detectors.
    """

    cue: CueRecord
    before: Rate
    false: tuple[int, int]  # fault-free motions with this cue, and all


class Knowledge(NamedTuple):
    """Time from the first effect to the first possible knowledge, over faults with an unintended
    motion.
    """

    delay: Incidence
    half_ms: Estimate
    quarter_ms: Estimate
    # over the motion, of what may come before it: no cue at the motion's own distance or beyond
    lead: Lead
    lower: (
        LowerCue | None
    )  # where the cue of the verdicts is such a cue: the nearest below the limit, if there is any
    never: Rate  # not known when the run ended
    # the campaign has detectors, which count at their lowest threshold without a false alarm
    by_detectors: bool


class Announced(NamedTuple):
    """Of evading faults, what a cue announces before the motion exceeds the limit."""

    cue: CueRecord
    lead: Lead
    lead_ms: Estimate  # median
    false: Rate  # of fault-free motions, those with this cue
    per_hour: AlarmRate | None  # false ones an hour


class Changed(NamedTuple):
    """What the cue would change: pairs where the campaign has them, else what it announces."""

    pairs: list[Difference]  # all faults, one for each reaction
    announced: Announced | None  # by the cue of the verdicts; None: no cue, or nothing evaded
    # whether it is a finding that this cue comes before the motion, and no matter of definitions
    leads: bool
    lower: int  # of how many cues it is a finding
    better: (
        Announced | None
    )  # the cue that announces most without a false one, where it is another and leads


def knowledge(runs: Runs, known: str, early: str, manifest: Manifest) -> Knowledge:
    """known: when anyone could first know, -1 if never, an expression of columns of facts
    (`performance.known`); early: the same of what may come before the motion
    (`performance.before_motion`)."""
    end, sampled = end_of(manifest), runs.sampled()
    delay = runs.delays(known, "active_ms", end, UNINTENDED)[""]
    delays, lead = (
        counted.incidence(delay),
        counted.lead(runs.delays(early, "unintended_ms", end, UNINTENDED)[""]),
    )
    never = delays.n - delays.events
    return Knowledge(
        delays,
        tables.known(delays.quantile_interval(0.5), sampled),
        tables.known(delays.quantile_interval(0.25), sampled),
        lead._replace(before=tables.known(lead.before, sampled)),
        _lower(runs, early, manifest),
        tables.of_faults(runs, never, delays.n),
        bool(manifest.detectors),
    )


def _lower(runs: Runs, early: str, manifest: Manifest) -> LowerCue | None:
    able = [k for k in range(len(manifest.cues)) if leads.cue(manifest, k)]
    if runs.cue_leads or not able:
        return None
    nearest = max(able, key=lambda k: manifest.cues[k].threshold_mm)
    event = first_sql(early, f"({after_onset(f'warned{nearest}_ms')})")
    lags = runs.delays(event, "unintended_ms", end_of(manifest), UNINTENDED)[""]
    free = runs.motions()
    false = free.came(f"golden_cue{nearest}_first_ms"), free.count
    return LowerCue(
        manifest.cues[nearest], tables.known(counted.lead(lags).before, runs.sampled()), false
    )


def classes(runs: Runs, known: str, early: str, manifest: Manifest) -> dict[str, list[ClassRow]]:
    """Rows by each of CLASSES, most evasive first; a kind of class that is the same for all faults
    is left out.

    known, early: as of `knowledge`.
    """
    by_kind = {}
    for kind in CLASSES:
        present = runs.faults(kind)
        if len(present) > 1 or (kind == "group" and present):
            delay, lags = (
                runs.delays(event, start, end_of(manifest), UNINTENDED, kind)
                for event, start in ((known, "active_ms"), (early, "unintended_ms"))
            )
            groups = runs.groups_by(kind)
            rows = [
                _class(
                    one,
                    delay.get(one.name, NONE),
                    lags.get(one.name, NONE),
                    runs.sampled(groups[one.name]),
                )
                for one in present
            ]
            by_kind[kind] = sorted(rows, key=_most_evasive)
    return by_kind


def changed(runs: Runs, manifest: Manifest, differences: Sequence[Difference]) -> Changed:
    """differences: of all reactions, none where the campaign has no pairs."""
    condition = "sample AND faulty AND evaded"
    announcements = []
    if runs.count(condition) and runs.motions().count:
        announcements = [
            _announced(runs, manifest, k, condition) for k in range(len(manifest.cues))
        ]
    first = announcements[manifest.verdict_cue] if announcements else None
    able = [leads.cue(manifest, k) for k in range(len(manifest.cues))]
    quiet = [
        one
        for one, leading in zip(announcements, able, strict=False)
        if leading and not one.false.k
    ]
    best = max(quiet, key=lambda one: (one.lead.before.value, one.cue.threshold_mm), default=None)
    surpassed = best and first and (not runs.cue_leads or best.lead.before.k > first.lead.before.k)
    whole = [row for row in differences if row.among == "all faults"]
    return Changed(whole, first, runs.cue_leads, sum(able), best if surpassed else None)


def _announced(runs: Runs, manifest: Manifest, k: int, chosen: str) -> Announced:
    free = runs.motions()
    lead = counted.lead(
        runs.delays(after_onset(f"warned{k}_ms"), "unintended_ms", end_of(manifest), chosen)[""]
    )
    false = tables.rate_of(free.came(f"golden_cue{k}_first_ms"), free.count)
    sampled = runs.sampled()
    lead = lead._replace(before=tables.known(lead.before, sampled))
    return Announced(
        manifest.cues[k], lead, tables.known(lead.quantile(0.5), sampled), false, free.cue_rate(k)
    )


def _most_evasive(row: ClassRow) -> tuple[Any, ...]:
    return *tables.least_last(row.evaded), *tables.least_last(row.unintended), row.name


def _class(faults: FaultCounts, delay: Delays, lags: Delays, sampled: bool) -> ClassRow:
    """sampled: whether the faults were drawn."""
    return ClassRow(
        faults.name,
        tables.known(tables.rate_of(faults.evaded, faults.faults), sampled),
        tables.known(tables.rate_of(faults.unintended, faults.faults), sampled),
        tables.known(tables.rate_of(faults.loss, faults.faults), sampled),
        tables.known(counted.lead(lags).before, sampled),
        tables.known(counted.incidence(delay).quantile_interval(0.5), sampled),
    )
