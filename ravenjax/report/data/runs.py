"""Queries over all runs of a campaign: the result table beside the facts of each run.

Whatever a section counts is counted over all rows. What needs the rows themselves takes at most a
given number of them, drawn by a hash of the row's number, so that the same table always gives the
same rows; the page says so.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import pandas as pd

from ravenjax.outcomes import events
from ravenjax.report.data import draws
from ravenjax.report.data import facts as run_facts
from ravenjax.report.data import fault_free as fault_free_motions
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.fault_free import Motions
from ravenjax.stats.latency import NONE, Delays
from ravenjax.store import schema
from ravenjax.store.access import fault_free, query
from ravenjax.store.access.fault_free import NO_COMPANIONS, Companions
from ravenjax.store.access.query import RESULTS, ResultTable, quoted
from ravenjax.store.manifest import DetectorRecord, Manifest

UNINTENDED = "sample AND faulty AND unintended"
"""Condition of the runs whose times are told: one run of each fault that made an unintended
motion.
"""
TIP_ERROR = "tip_error"
"""Kind of the detector that measures how far the reported tip is from the nominal model, mm."""

_Answer = TypeVar("_Answer")


class FaultCounts(NamedTuple):
    """Distinct faults of one class, by the first valid run of each in which nobody reacts."""

    name: str
    runs: int  # of these faults: repeats, runs with a reaction and failed ones among them
    faults: int
    evaded: int
    unintended: int  # unintended motion, whatever the checks did
    loss: int  # loss of motion, whatever the checks did
    alarms: int  # a check told a person or stopped the robot


class Runs:
    """The runs of one campaign. Tables: `results`, as in the parts, and `facts`, as
    `facts.define`; both have `row`.
    """

    def __init__(
        self, table: ResultTable, manifest: Manifest, beside: Companions = NO_COMPANIONS
    ) -> None:
        """table: has `results` with a column `row`; beside: further fault-free motion."""
        self.table, self.types, self.manifest = table, table.types(), manifest
        self.robot = manifest.robot
        # when a run ended, ms: a number, or the column of facts that has it for each run
        self.end = schema.OBSERVED if manifest.shape.observes else str(manifest.duration_ms)
        self._beside = beside
        self._drawn_groups = draws.groups(manifest.config)
        self.names = list(self.types)
        run_facts.define(table, run_facts.choices(manifest), _more(manifest))
        self.facts = list(table.types(FACTS))
        self.rows = self.count("true")
        self._motions: Motions | None = None
        self._answers: dict[Any, Any] = {}
        self._cube: pd.DataFrame | None = None

    @staticmethod
    def open(folder: Path, manifest: Manifest) -> Runs:
        """Open the runs of a result folder. Raises StoreError as `query.open_folder`."""
        table = query.open_folder(folder)
        try:
            return Runs(table, manifest, fault_free.find(folder, manifest))
        except BaseException:
            table.close()
            raise

    @staticmethod
    def of(frame: pd.DataFrame, manifest: Manifest) -> Runs:
        """The runs of a result table in memory; a row's number is its place."""
        table = query.empty()
        run_facts.take(table, frame)
        return Runs(table, manifest)

    def close(self) -> None:
        """Give back memory and disk."""
        self.table.close()

    def once(self, question: Callable[[Runs], _Answer]) -> _Answer:
        """The answer to a question that several sections ask: computed for the first of them."""
        if question not in self._answers:
            self._answers[question] = question(self)
        return self._answers[question]

    @property
    def cue_leads(self) -> bool:
        """Whether there are cues, and the lead of the one of the verdicts is a finding."""
        manifest = self.manifest
        return bool(manifest.cues) and cue_leads(manifest, manifest.verdict_cue)

    def count(self, condition: str, table: str = FACTS) -> int:
        """How many rows fulfil a condition."""
        return self.counts([condition], table)[0]

    def counts(self, conditions: list[str], table: str = FACTS, where: str = "true") -> list[int]:
        """How many rows fulfil each condition, in one pass."""
        columns = ", ".join(f"count(*) FILTER ({condition})" for condition in conditions)
        return (
            list(self.table.row(f"SELECT {columns} FROM {table} WHERE {where}"))
            if conditions
            else []
        )

    def sampled(self, groups: Collection[str] | None = None) -> bool:
        """Whether the faults of these groups, or of all groups with faults, were drawn: what was
        enumerated is no sample, and a rate of it has no interval."""
        if self._drawn_groups is None:
            return True
        if groups is None:
            cube = self.cube()
            groups = set(cube.loc[cube["faulty"], "group"])
        return set(groups) <= self._drawn_groups

    def groups_by(self, kind: str, where: str = "faulty") -> dict[str, set[str]]:
        """Groups of the faults of each class, a value of the column `kind` of facts, among runs
        with a fault or some of them."""
        rows = self.table.rows(
            f'SELECT DISTINCT {quoted(kind)}, "group"::VARCHAR FROM {FACTS} WHERE {where}'
        )
        classes: dict[str, set[str]] = {}
        for name, group in rows:
            classes.setdefault(str(name), set()).add(group)
        return classes

    def cube(self) -> pd.DataFrame:
        """Counts (`runs`) by group, response, hazard, outcome, cued, faulty, failed, evaded,
        plain and sample.
        """
        if self._cube is None:
            words = ("group", "response", "hazard", "outcome")
            names = ", ".join(
                map(quoted, (*words, "cued", "faulty", "failed", "evaded", "plain", "sample"))
            )
            frame = self.table.frame(f"SELECT {names}, count(*) AS runs FROM {FACTS} GROUP BY ALL")
            self._cube = frame.astype(dict.fromkeys(words, "str"))
        return self._cube

    def groups(self) -> list[str]:
        """Names of the campaign's groups that have runs."""
        return sorted(self.cube()["group"].unique().tolist())

    def faults(self, by: str | None = None) -> list[FaultCounts]:
        """Distinct faults, of all together or by each value of a column."""
        name = quoted(by) if by else "''"
        counts = ", ".join(
            f"count(*) FILTER (sample{also})"
            for also in ("", *(f" AND {n}" for n in ("evaded", "unintended", "loss", "told")))
        )
        rows = self.table.rows(
            f"SELECT {name} AS name, count(*), {counts} FROM {FACTS} WHERE faulty GROUP BY name"
        )
        if by is None and not rows:
            return [FaultCounts("", 0, 0, 0, 0, 0, 0)]
        return sorted(FaultCounts(str(name), *numbers) for name, *numbers in rows)

    def delays(
        self, event: str, start: str, end: str, where: str, by: str | None = None
    ) -> dict[str, Delays]:
        """How long after `start` an event came, or how long until `end` it did not: expressions of
        columns of `facts`, in ms, the event -1 where it never came. Of all runs together under "",
        or by each value of a column."""
        name = quoted(by) if by else "''"
        frame = self.table.frame(
            f"SELECT {name} AS name, CASE WHEN ({event}) >= 0 THEN ({event}) ELSE {end} END -"
            f" {start} AS time, ({event}) >= 0 AS came, count(*) AS count FROM {FACTS} WHERE"
            f" {where} GROUP BY ALL ORDER BY time, came"
        )
        by_name = {
            str(key): Delays(*(part[column].to_numpy() for column in ("time", "came", "count")))
            for key, part in frame.groupby("name", observed=True)
        }
        return by_name if by or by_name else {"": NONE}

    def those(self, where: str) -> str:
        """The rows of `results` whose facts fulfil a condition, to select from."""
        return f"{RESULTS} SEMI JOIN (SELECT row FROM {FACTS} WHERE {where}) USING (row)"

    def motions(self) -> Motions:
        """The different fault-free motions: golden runs of runs that are plain, and those beside
        the result.
        """
        if self._motions is None:
            source = self.those("plain") if self.count("NOT plain") else RESULTS
            self._motions = fault_free_motions.make(
                self.table, self.names, source, self.end, self._beside
            )
        return self._motions

    def numbered(self, rows: list[int]) -> list[dict[str, Any]]:
        """These rows, in their order: every column of `results`, and those of `facts` that have
        other names.
        """
        if not rows:
            return []
        listed = ", ".join(map(str, rows))
        own = [name for name in self.facts if name not in self.names]
        raw = self.table.frame(f"SELECT * FROM {RESULTS} WHERE row IN ({listed})").set_index("row")
        facts = self.table.frame(
            f"SELECT row, {', '.join(map(quoted, own))} FROM {FACTS} WHERE row IN ({listed})"
        )
        return raw.join(facts.set_index("row")).loc[rows].to_dict("records")  # pyright: ignore[reportReturnType]

    def drawn(
        self, columns: str, where: str, most: int, by: str = "row", of: str = ""
    ) -> pd.DataFrame:
        """Rows of `results` and `facts` joined, in order: all that fulfil a condition, or about
        `most` of them.

        by: rows that are equal in it come together or not at all. of: a query that stands for
        `facts`.
        """
        (n,) = self.counts([where])
        some = (
            "true" if n <= most else f"hash({quoted(by)} + 1) % {2**32} < {int(2**32 * most / n)}"
        )
        return self.table.frame(
            f"SELECT {columns} FROM {RESULTS} JOIN ({of or f'SELECT * FROM {FACTS} WHERE {where}'})"
            f" AS {FACTS} USING (row) WHERE {some} ORDER BY row"
        )


def after_onset(event: str) -> str:
    """A time of facts, -1 where it lies before the fault's first effect: it tells of something
    else then.
    """
    return f"CASE WHEN {event} >= active_ms THEN {event} ELSE -1 END"


def cue_leads(manifest: Manifest, number: int) -> bool:
    """Whether it is a finding that a cue comes before an unintended motion.

    Cue and tip-error detector fire at a distance of the reported tip from the nominal model; an
    unintended motion begins where the true tip is farther than the limit from that model, and from
    more. So an alarm at the limit or beyond is no warning of the motion, by the definitions alone.
    """
    return manifest.cues[number].threshold_mm < manifest.limit_mm


def detector_leads(manifest: Manifest, detector: DetectorRecord, threshold: float) -> bool:
    """Whether it is a finding that a detector at a threshold alarms before the motion."""
    return detector.kind != TIP_ERROR or threshold < manifest.limit_mm


def _more(manifest: Manifest) -> dict[str, str]:
    """Further columns of facts: warned<k>_ms of each haptic set, alarm<d>_<k>_ms of each threshold
    of each detector, and when runs ended if not all together."""
    warned = {f"warned{k}_ms": run_facts.warned_sql(k) for k in range(len(manifest.cues))}
    alarms = {
        f"alarm{d}_{k}_ms": f"detector{d}_threshold{k}_first_ms"
        for d, detector in enumerate(manifest.detectors)
        for k in range(len(detector.thresholds))
    }
    ended = {schema.OBSERVED: schema.OBSERVED} if manifest.shape.observes else {}
    return warned | alarms | ended | _own_checks(manifest)


def _own_checks(manifest: Manifest) -> dict[str, str]:
    """own<n>_ms, when each check of one's own first did what it does not in the golden run, and
    built_in_told_ms.
    """
    own = manifest.shape.own_checks
    column = "told_ms" if manifest.rules.built_in == "response" else "built_in_told_ms"
    times = {f"own{n}_ms": events.check_ms_sql(check.name) for n, check in enumerate(own)}
    return times | {"built_in_told_ms": column} if own else {}
