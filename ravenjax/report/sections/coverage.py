"""Section "Coverage of checks": the share of harmful faults that a check detects.

IEC 61508-4 defines diagnostic coverage as the rate of detected dangerous failures divided by the
rate of all dangerous failures. In this module a fault is dangerous if its run has an unintended
motion. A fault that a check makes harmless is therefore not dangerous. To learn what such a fault
would have done, run the campaign without the check, or with a check that only watches.
"""

import contextlib
import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd

from ravenjax import resources
from ravenjax.errors import StoreError, UserError, suggest_name
from ravenjax.outcomes import events
from ravenjax.report import wording
from ravenjax.report.data import pair_intervals
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs, after_onset
from ravenjax.report.sections.detectors import list_alarms
from ravenjax.report.sections.tables import EVERY_SITE
from ravenjax.stats.intervals import Rate
from ravenjax.store.access import explained
from ravenjax.store.access.query import RESULTS, quote_name

Kind = Literal["built-in check", "user's check", "detector", "cue"]
EVERYTHING = "all checks and detectors"
TOGETHER: dict[str, list[Kind]] = resources.read_tables(__file__, "coverage.toml")
"""Sets of kinds of sources whose detections are also counted together."""
VALID = f"plain AND faulty AND {FACTS}.activated AND NOT {FACTS}.failed"
"""SQL condition: a fault changed a bit, the outcome is valid, and the operator does not react."""
ACTION = "stop"
"""The action whose deadlines are used, see `ravenjax deadline`."""
_LATEST = np.iinfo(np.int32).max
"""Replaces the time of an event that never happens."""


class Source(NamedTuple):
    """A check, a detector at one threshold, or the cue."""

    name: str
    kind: Kind
    does: str  # its effect, as text
    sql: str  # time at which the source detects the fault of a run, ms; -1: never
    # True if the source reports a fault by itself. False for a check that limits without an alarm,
    # and for a check that also trips after another check stopped the robot. A detector reports at
    # its lowest threshold without a false alarm.
    reports: bool


class Coverage(NamedTuple):
    """The harmful faults of one site that one source, or several sources together, detect."""

    site: str  # a fault site, or EVERY_SITE
    name: str
    does: str
    detected: Rate  # share of the harmful faults that are detected
    before: Rate  # share that is detected before the harm
    in_time: Rate | None  # share detected by the deadline of a stop; None: no deadlines
    alone: int  # number of faults that no other source reports


class SmallestSets(NamedTuple):
    """The smallest sets of sources that detect as many faults as all sources together."""

    criterion: str  # name of a field of Coverage
    faults: int
    sets: Sequence[tuple[str, ...]]


class CoverageTable(NamedTuple):
    """The coverage of every source, for all harmful faults and for those of each site.

    harmful: one row per run, with the columns row, run_id, group, site, distinct, effect_ms,
    harm_ms, deadline_ms and the time at which each source detects the fault. A time is -1 if the
    event never happens. deadline_ms is also -1 if the deadline is unknown.
    """

    harmful: pd.DataFrame
    sources: Sequence[Source]
    rows: Sequence[Coverage]
    # Latest time of a detection that counts, ms [harmful], by criterion, a field of Coverage.
    latest: Mapping[str, np.ndarray]
    notices: Sequence[str]

    @property
    def smallest(self) -> list[SmallestSets]:
        """Return the smallest sets for each criterion. This tries combinations of sources."""
        return [_smallest(self.harmful, self.sources, *item) for item in self.latest.items()]

    def list_runs(self, name: str, runs: Runs) -> list[tuple[str, ...]]:
        """Return for each harmful fault: run, site, fault, times of harm and detection, and order.

        `name`: of a source, or of a set of sources. Raise UserError for an unknown name.
        """
        teams = {source.name: [source] for source in self.sources} | _together(self.sources)
        if name not in teams:
            raise UserError(
                f"--runs {name!r}: unknown check, expected one of {', '.join(teams)}"
                f"{suggest_name(name, teams)}"
            )
        detected_ms = _first_ms(self.harmful, teams[name])
        faults = runs.whole_rows(self.harmful["row"].tolist())
        columns = (self.harmful[key] for key in ("run_id", "site", "harm_ms"))
        return [
            (
                run_id,
                site,
                wording.describe_fault(fault, runs.robot),
                str(harm),
                str(ms) if ms >= 0 else wording.DASH,
                "never" if ms < 0 else "before the harm" if ms < harm else "after the harm",
            )
            for run_id, site, harm, ms, fault in zip(*columns, detected_ms, faults, strict=True)
        ]


def list_sources(runs: Runs) -> list[Source]:
    """Return the checks that may act in these runs, the detectors, and the cue of the verdicts."""
    sources = []
    for name in runs.manifest.shape.checks:
        check = runs.manifest.robot.check(name)
        kind: Kind = "user's check" if check.own else "built-in check"
        # A check `follows` if it also trips after another check stopped the robot.
        reports = check.action != "limit" and not check.follows
        sources.append(Source(name, kind, check.does, events.check_ms_sql(name), reports))
    for alarms in runs.once(list_alarms):
        if alarms.column == "warned_ms":
            sources.append(Source(alarms.name, "cue", "pulls at the hand", alarms.column, False))
        # The column of all checks together is left out, because each check is a source already.
        elif alarms.column != "told_ms":
            name = f"{alarms.name} above {alarms.threshold:g}"
            sources.append(Source(name, "detector", "raises an alarm", alarms.column, alarms.quiet))
    return sources


def times_sql(sources: Sequence[Source]) -> str:
    """Return SQL columns of the times (ms, -1: never) at which each source detects a fault."""
    return "".join(f", {after_onset(f'({one.sql})')} AS {quote_name(one.name)}" for one in sources)


def measure_coverage(runs: Runs, deadlines: pd.DataFrame | None = None) -> CoverageTable:
    """Measure the coverage of each source in the runs of a campaign.

    `deadlines`: table of `explained.read_deadlines`. Intervals resample the
    distinct faults, or are Wilson's if each fault has one run. Enumerated faults have no interval.
    """
    sources = list_sources(runs)
    harmful = runs.table.frame(
        f'SELECT row, run_id, {FACTS}."group"::VARCHAR AS "group", site::VARCHAR AS site,'
        ' "distinct", active_ms AS effect_ms, unintended_ms AS harm_ms, -1 AS deadline_ms'
        f"{times_sql(sources)} FROM {RESULTS} JOIN {FACTS} USING (row) WHERE {VALID} AND unintended"
        " ORDER BY row"
    )
    latest = {
        "detected": np.full(len(harmful), _LATEST),
        "before": harmful["harm_ms"].to_numpy() - 1,
    }
    unknown = fickle = 0
    if deadlines is not None:
        stops = deadlines.loc[deadlines["action"] == ACTION].set_index("run")
        stops = stops.reindex(harmful["run_id"])
        after = stops["deadline_ms"].to_numpy(float)
        unknown = int(stops["effect_ms"].isna().sum())
        fickle = int((stops["monotone"] == False).sum())  # noqa: E712
        harmful["deadline_ms"] = np.where(
            after >= 0, stops["effect_ms"].to_numpy(float) + after, -1
        ).astype(int)
        latest["in_time"] = harmful["deadline_ms"].to_numpy()
    notices = wording.fill_template(
        "coverage.txt.j2",
        kept=runs.count(f"{VALID} AND response = 'stopped' AND NOT unintended"),
        limit_mm=runs.manifest.limit_mm,
        harmful=len(harmful),
        sampled=runs.sampled(set(harmful["group"])),
        varied=[name for name in runs.names if name.startswith("param:checks.")],
        deadlines=deadlines is not None,
        # The import of a bundled robot takes seconds, and all of these declare actions.
        acts=(robot := runs.robot).package.startswith("ravenjax.")
        or hasattr(robot.part("campaign"), "acted"),
        unknown=unknown,
        fickle=fickle,
    )
    rows = list(_rows(runs, harmful, sources, latest))
    return CoverageTable(harmful, sources, rows, latest, notices)


def _together(sources: Sequence[Source]):
    # Returns the sets of sources that are counted together, without sets that equal EVERYTHING. The
    # cue counts in sets with cues, although it only informs the operator.
    teams = {
        name: [one for one in sources if one.kind in kinds and (one.reports or one.kind == "cue")]
        for name, kinds in TOGETHER.items()
    }
    return {
        name: team
        for name, team in teams.items()
        if team and (name == EVERYTHING or team != teams[EVERYTHING])
    }


def _first_ms(harmful: pd.DataFrame, team: Sequence[Source]) -> np.ndarray:
    """Return when the first of several sources detects each fault, ms; -1: never."""
    times = harmful[[one.name for one in team]].to_numpy()
    first = np.where(times >= 0, times, _LATEST).min(axis=1, initial=_LATEST)
    return np.where(first < _LATEST, first, -1)


def _rows(
    runs: Runs, harmful: pd.DataFrame, sources: Sequence[Source], latest: Mapping[str, np.ndarray]
) -> Iterator[Coverage]:
    # Yields the coverage of each source and each set of sources, for all sites and for each site.
    # latest: by criterion (a field of Coverage), the latest time at which a detection counts.
    sites = {EVERY_SITE: np.full(len(harmful), True)}
    sites |= {site: (harmful["site"] == site).to_numpy() for site in sorted(set(harmful["site"]))}
    reporting = [one for one in sources if one.reports]
    teams = {one.name: [one] for one in sources} | _together(sources)
    effects = {one.name: one.does for one in sources}
    for site, here in sites.items():
        is_sampled = runs.sampled(set(harmful["group"].to_numpy()[here]))
        faults = pair_intervals.pair_faults(harmful["distinct"].to_numpy()[here], is_sampled)
        for name, team in teams.items():
            ms = _first_ms(harmful, team)[here]
            # For a single site, sources that detect nothing are left out.
            if site != EVERY_SITE and name != EVERYTHING and not (ms >= 0).any():
                continue
            others = _first_ms(harmful, [one for one in reporting if one not in team])[here]
            rates = {
                criterion: pair_intervals.pair_rate((ms >= 0) & (ms <= limit[here]), faults)
                for criterion, limit in latest.items()
            }
            in_time = rates.pop("in_time", None)
            # Faults that only this team detects.
            alone = int(((ms >= 0) & (others < 0)).sum())
            does = effects.get(name, "")
            yield Coverage(site, name, does, in_time=in_time, alone=alone, **rates)


def _smallest(
    harmful: pd.DataFrame, sources: Sequence[Source], criterion: str, limit: np.ndarray
) -> SmallestSets:
    # Finds the smallest sets of sources that detect every fault that any source detects. limit:
    # latest time at which a detection of each fault counts, ms. A source that alone detects some
    # fault is in every set. Combinations of the others are tried, the smallest first.
    names = [source.name for source in sources if source.reports]
    ms = harmful[names].to_numpy()
    hits = (ms >= 0) & (ms <= limit[:, None])  # [faults, sources]
    hits = hits[hits.any(axis=1)]
    # Faults that the same sources detect count once.
    kinds = np.unique(hits, axis=0)
    needed = kinds[kinds.sum(axis=1) == 1].any(axis=0)
    others, complete, size = np.flatnonzero(kinds.any(axis=0) & ~needed), [], 0
    while not complete:
        teams = ((*np.flatnonzero(needed), *more) for more in itertools.combinations(others, size))
        complete = [team for team in teams if kinds[:, team].any(axis=1).all()]
        size += 1
    sets = [tuple(names[index] for index in team) for team in complete]
    return SmallestSets(criterion, len(hits), sets)


def _content(runs: Runs, folder: Path):
    deadlines = None
    # The section of the deadlines says why they cannot be read.
    with contextlib.suppress(StoreError):
        deadlines = explained.read_rows(folder / explained.DEADLINES, runs.manifest, "deadline")
    found = measure_coverage(runs, deadlines)
    rows = [row for row in found.rows if row.site == EVERY_SITE and row.detected.k]
    return {"found": found, "rows": rows} if rows else None


SECTIONS = {"coverage": _content}
