"""Queries all runs of a campaign: the result table, joined with facts that follow from its columns.

Counts in the report use all rows. Computations that need the rows in memory use at most a given
number of rows. These rows are chosen by a hash of the row number, so the same table always gives
the same rows. The page states whether all rows were used.
"""

import functools
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any, TypeVar

import pandas as pd

from ravenjax.outcomes import events
from ravenjax.report.data import draws
from ravenjax.report.data import facts as run_facts
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.fault_free import Motions, make_fault_free_table
from ravenjax.stats.latency import NO_DELAYS, Delays
from ravenjax.store import schema
from ravenjax.store.access import fault_free, query
from ravenjax.store.access.fault_free import NO_COMPANIONS, Companions
from ravenjax.store.access.query import RESULTS, ResultTable, quote_name
from ravenjax.store.manifest import Manifest

DISTINCT_FAULTS = "sample AND faulty"
"""SQL condition: one valid run of each distinct fault that changed a bit, see `define_facts`."""
UNINTENDED = f"{DISTINCT_FAULTS} AND unintended"
"""SQL condition of the runs whose times are reported: unintended motions, one run of each fault."""
HARMFUL_EVADING = f"{DISTINCT_FAULTS} AND evaded AND unintended_ms >= 0"
"""SQL condition of the runs of evading faults whose motion is unintended, one run of each fault."""
TIP_ERROR = "tip_error"
"""Kind of the detector of the distance between reported tip and nominal model, in mm."""

_Answer = TypeVar("_Answer")


class Runs:
    """The runs of one campaign: the tables `results` and `facts`, which share the column `row`."""

    def __init__(self, table: ResultTable, manifest: Manifest, beside: Companions = NO_COMPANIONS):
        """Create the facts of a `table` that contains `results` with a column `row`.

        beside: additional fault-free motion in the result folder.
        """
        self.table, self.types, self.manifest = table, table.types(), manifest
        self.robot = manifest.robot
        # When a run ended, in ms: one number for all runs, or a column of facts.
        self.end = schema.OBSERVED if manifest.shape.observes else str(manifest.duration_ms)
        self.beside = beside
        self._drawn_groups = draws.drawn_groups(manifest.config)
        self.names = list(self.types)
        run_facts.define_facts(table, run_facts.recorded_choices(manifest), _more(manifest))
        self.facts = list(table.types(FACTS))
        self.rows = self.count("true")
        self._answers: dict[Any, Any] = {}

    @staticmethod
    def open(folder: Path, manifest: Manifest) -> "Runs":
        """Open the runs of a result folder. Raises StoreError as `query.open_folder` does."""
        table = query.open_folder(folder)
        try:
            return Runs(table, manifest, fault_free.find_fault_free(folder, manifest))
        except BaseException:
            table.close()
            raise

    @staticmethod
    def of(frame: pd.DataFrame, manifest: Manifest) -> "Runs":
        """Return the runs of a result table in memory. A row's number is its position."""
        table = query.open_empty()
        run_facts.register_table(table, frame)
        return Runs(table, manifest)

    def close(self) -> None:
        """Release memory and disk space."""
        self.table.close()

    def once(self, question: "Callable[[Runs], _Answer]") -> _Answer:
        """Return `question(self)`, computed once, because several sections need the result."""
        if question not in self._answers:
            self._answers[question] = question(self)
        return self._answers[question]

    def count(self, condition: str) -> int:
        """Return the number of rows that fulfil a condition."""
        return self.counts([condition])[0]

    def counts(self, conditions: list[str], table: str = FACTS, where: str = "true") -> list[int]:
        """Return the number of rows that fulfil each condition, in one query."""
        if not conditions:
            return []
        columns = ", ".join(f"count(*) FILTER ({condition})" for condition in conditions)
        return list(self.table.row(f"SELECT {columns} FROM {table} WHERE {where}"))

    def sampled(self, groups: Collection[str] | None = None) -> bool:
        """Return whether the faults of these groups (None: of all) were drawn, not enumerated."""
        if self._drawn_groups is None:
            return True
        if groups is None:
            groups = set(self.cube.loc[self.cube["faulty"], "group"])
        return set(groups) <= self._drawn_groups

    def groups_by(self, kind: str) -> dict[str, set[str]]:
        """Return the groups that have faults with each value of a column of facts, such as site."""
        rows = self.table.rows(
            f'SELECT DISTINCT {quote_name(kind)}, "group"::VARCHAR FROM {FACTS} WHERE faulty'
        )
        groups: dict[str, set[str]] = {}
        for value, group in rows:
            groups.setdefault(str(value), set()).add(group)
        return groups

    @functools.cached_property
    def cube(self) -> pd.DataFrame:
        """The number of runs (`runs`) for each combination of group, outcome and so on."""
        words = ("group", "response", "hazard", "outcome")
        flags = ("cued", "faulty", "failed", "evaded", "plain", "sample")
        names = ", ".join(map(quote_name, words + flags))
        frame = self.table.frame(f"SELECT {names}, count(*) AS runs FROM {FACTS} GROUP BY ALL")
        return frame.astype(dict.fromkeys(words, "str"))

    def groups(self) -> list[str]:
        """Return the names of the groups that have runs."""
        return sorted(self.cube["group"].unique().tolist())

    def delays(
        self, event: str, start: str, end: str, where: str, by: str | None = None
    ) -> dict[str, Delays]:
        """Return the delays from `start` to an event, or to `end` if the event did not occur.

        event, start, end: SQL for times in ms, over columns of `facts`; the event's is -1 if it did
        not occur. where: condition on the runs. by: column whose values group the runs and are the
        keys of the result; without this column, the only key is "".
        """
        name = quote_name(by) if by else "''"
        frame = self.table.frame(
            f"SELECT {name} AS name, CASE WHEN ({event}) >= 0 THEN ({event}) ELSE {end} END -"
            f" {start} AS time, ({event}) >= 0 AS came, count(*) AS count FROM {FACTS} WHERE"
            f" {where} GROUP BY ALL ORDER BY time, came"
        )
        by_name = {
            str(key): Delays(*(part[column].to_numpy() for column in ("time", "came", "count")))
            for key, part in frame.groupby("name", observed=True)
        }
        return by_name if by or by_name else {"": NO_DELAYS}

    def matching(self, where: str) -> str:
        """Return a query for the rows of `results` whose facts fulfil a condition."""
        return f"{RESULTS} SEMI JOIN (SELECT row FROM {FACTS} WHERE {where}) USING (row)"

    @functools.cached_property
    def motions(self) -> Motions:
        """The different fault-free motions: golden runs, and those added to the folder."""
        source = self.matching("plain") if self.count("NOT plain") else RESULTS
        return make_fault_free_table(self.table, self.names, source, self.end, self.beside)

    def whole_rows(self, rows: list[int]) -> list[dict[str, Any]]:
        """Return these rows in their order, with all columns of `results` and of `facts`."""
        if not rows:
            return []
        listed = ", ".join(map(str, rows))
        more = ", ".join(quote_name(name) for name in self.facts if name not in self.names)
        frame = self.table.frame(
            f"SELECT {RESULTS}.*, {more} FROM {RESULTS} JOIN {FACTS} USING (row) WHERE row IN"
            f" ({listed})"
        )
        return frame.set_index("row").loc[rows].to_dict("records")  # pyright: ignore[reportReturnType]

    def drawn(self, columns: str, where: str, most: int, by: str = "row") -> pd.DataFrame:
        """Return joined rows of `results` and `facts`, in order, that fulfil the condition `where`.

        Of more than `most` rows, about `most` are drawn. Rows with the same value in column `by`
        are kept or left out together.
        """
        share = min(1.0, most / max(1, self.count(where)))
        # Equal numbers have equal hashes, so the draw is the same at each call. The hash of 0 is 0,
        # so without adding 1, a 0 would always be drawn.
        return self.table.frame(
            f"SELECT {columns} FROM {RESULTS} JOIN (SELECT * FROM {FACTS} WHERE {where}) AS {FACTS}"
            f" USING (row) WHERE hash({quote_name(by)} + 1) % {2**32} < {int(2**32 * share)}"
            " ORDER BY row"
        )


def after_onset(event: str) -> str:
    """Return SQL for the time of an event in ms; -1 if the event came before the fault's effect.

    Such an event has another cause than the fault.
    """
    return f"CASE WHEN {event} >= active_ms THEN {event} ELSE -1 END"


def _more(manifest: Manifest):
    """Return further columns of facts. They are warned<k>_ms for each haptic set, alarm<d>_<k>_ms
    for each threshold of each detector, own<n>_ms for each user's check, built_in_told_ms if there
    are such checks, and the times at which runs ended if these differ.
    """
    checks, columns = manifest.shape.own_checks, {}
    for k in range(len(manifest.cues)):
        columns[f"warned{k}_ms"] = events.beyond_golden_sql(f"cue{k}_first_ms")
    for d, detector in enumerate(manifest.detectors):
        for k in range(len(detector.thresholds)):
            columns[f"alarm{d}_{k}_ms"] = f"detector{d}_threshold{k}_first_ms"
    for n, check in enumerate(checks):
        columns[f"own{n}_ms"] = events.check_ms_sql(check.name)
    if checks:
        # `built_in` is the column with the response of the built-in checks. It is `response` if
        # other checks cannot change the response.
        is_separate = manifest.rules.built_in != "response"
        columns["built_in_told_ms"] = "built_in_told_ms" if is_separate else "told_ms"
    if manifest.shape.observes:
        columns[schema.OBSERVED] = schema.OBSERVED
    return columns
