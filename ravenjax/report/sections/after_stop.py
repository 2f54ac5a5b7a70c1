"""Section "After a stop": how long each check took to stop the robot, and how far the tip still
moved.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from ravenjax.report.data import facts as run_facts
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import Section, tables
from ravenjax.stats.intervals import Rate
from ravenjax.store.access.query import RESULTS

CHOSEN = "sample AND faulty AND response = 'stopped'"
QUANTILES = (0.5, 0.95, 1.0)
ALL = "every stop"


class StopQuantiles(NamedTuple):
    """Quantiles over some runs, in one unit."""

    median: float
    most: float  # 95 % of the runs are at or below this
    largest: float


class StopRow(NamedTuple):
    """Stops by one check. A fault that was run several times counts once."""

    cause: str
    n: int
    took_ms: StopQuantiles  # from the fault's first effect to the stop
    before: Rate  # runs whose motion was beyond the limit before the stop
    after: Rate  # runs whose motion was beyond the limit only after the stop
    # Largest distance of the tip from its course while the robot was not live.
    off_mm: StopQuantiles
    cue_before: Rate
    cue_after: Rate  # cue in the millisecond of the stop or later
    no_cue: Rate


def rows(runs: Runs) -> list[StopRow]:
    """Return a row for all stops, then one for each check that stopped, most frequent first; no
    rows without a stop.
    """
    stops = _of(runs, "''")
    if not stops:
        return []
    causes = sorted(_of(runs, "response_cause::VARCHAR"), key=lambda row: (-row.n, row.cause))
    if len(causes) == 1:
        return [causes[0]._replace(cause=f"{ALL}: {causes[0].cause}")]
    return [stops[0]._replace(cause=ALL), *causes]


def _of(runs: Runs, by: str) -> list[StopRow]:
    listed = ", ".join(map(str, QUANTILES))
    moved = "unintended_ms >= 0 AND unintended_ms <= stop_ms"
    off = run_facts.beyond_sql("unintended_off_mm", runs.manifest.limit_mm, runs.types)
    counts = runs.table.rows(
        f"SELECT {by} AS cause, count(*), quantile_cont(stop_ms - active_ms, [{listed}]), count(*)"
        f" FILTER ({moved}), count(*) FILTER (NOT ({moved}) AND {off}),"
        f" quantile_cont(unintended_off_mm::DOUBLE, [{listed}]), count(*) FILTER (warned_ms >= 0"
        ' AND warned_ms < stop_ms), count(*) FILTER (warned_ms >= stop_ms), list(DISTINCT "group")'
        f" FROM (SELECT row, response_cause, unintended_off_mm FROM {RESULTS}) JOIN (SELECT row,"
        ' response_ms AS stop_ms, active_ms, unintended_ms, warned_ms, "group"::VARCHAR AS "group"'
        f" FROM {FACTS} WHERE {CHOSEN}) USING (row) GROUP BY cause"
    )
    out = []
    for cause, n, took, before, after, off_mm, cue_before, cue_after, groups in counts:
        no_cue = n - cue_before - cue_after
        of_all = [
            tables.of_faults(runs, k, n, groups)
            for k in (before, after, cue_before, cue_after, no_cue)
        ]
        out.append(
            StopRow(
                cause=cause or "not recorded",
                n=n,
                took_ms=StopQuantiles(*took),
                before=of_all[0],
                after=of_all[1],
                off_mm=StopQuantiles(*off_mm),
                cue_before=of_all[2],
                cue_after=of_all[3],
                no_cue=of_all[4],
            )
        )
    return out


def _content(runs: Runs, _: Path) -> dict[str, Any] | None:
    stops = rows(runs)
    return {"stops": stops} if stops else None


SECTIONS = (Section("after_stop", "After a stop", 120, _content),)
