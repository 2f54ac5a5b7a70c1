"""Which runs of a result table were worst, by what one asks."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

from ravenjax.errors import UserError, suggestion
from ravenjax.outcomes.events import Rules
from ravenjax.report.data.facts import faulty_sql
from ravenjax.store import manifest
from ravenjax.store.access import query
from ravenjax.store.access.query import RESULTS, ResultTable


class Ranking(NamedTuple):
    """What makes one run worse than another."""

    name: str
    sql: str  # larger is worse, NULL or 0 is no case; {cue} of the rules
    unit: str
    meaning: str


RANKINGS = {
    ranking.name: ranking
    for ranking in (
        Ranking(
            "unintended", "unintended_mm", "mm", "unintended motion of the true tip while live"
        ),
        Ranking("loss", "loss_mm", "mm", "loss of motion while live"),
        Ranking("report", "false_report_mm", "mm", "reported tip off the true one"),
        Ranking(
            "tissue",
            "tissue_depth_mm - golden_tissue_depth_mm",
            "mm",
            "deeper in the tissue than the golden run",
        ),
        Ranking("cue", "cue{cue}_ms", "ms", "time with a haptic cue"),
        Ranking(
            "response",
            "CASE WHEN response_ms >= 0 AND first_active_ms >= 0 THEN response_ms -"
            " first_active_ms END",
            "ms",
            "time from the fault's first effect to the check that responded",
        ),
    )
}


class WorstRun(NamedTuple):
    """One run and how bad it was."""

    row: int
    run_id: str
    value: float  # in the unit of the ranking


def worst(folder: Path, most: int, by: str = "unintended") -> list[WorstRun]:
    """The `most` worst valid runs with a fault, the worst first; fewer where fewer are cases at
    all.

    Raises UserError for an unknown ranking or a number below 1, StoreError as `query.open_folder`.
    """
    if by not in RANKINGS:
        raise UserError(
            f"--by {by}: unknown, expected {', '.join(RANKINGS)}{suggestion(by, RANKINGS)}"
        )
    if most < 1:
        raise UserError(f"--worst {most}: expected a number of runs, 1 or more")
    rules: Rules = manifest.read(folder).rules
    value = f"({RANKINGS[by].sql.format(cue=rules.cue)})::DOUBLE"
    with query.open_folder(folder) as table:
        faulty = faulty_sql(list(table.types()))
        cases = f"{RESULTS} WHERE failed = '' AND {faulty} AND {value} > 0 AND NOT isnan({value})"
        return ranked(table, cases, value, most)


def ranked(table: ResultTable, cases: str, value: str, most: int) -> list[WorstRun]:
    """The `most` worst runs, the worst first. cases: what to select from; value: an expression
    of its columns.
    """
    rows = table.rows(
        f"SELECT row, run_id, {value} AS value FROM {cases} ORDER BY value DESC, row LIMIT {most}"
    )
    return [WorstRun(row, str(run_id), float(value)) for row, run_id, value in rows]
