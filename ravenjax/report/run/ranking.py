"""Finds the worst runs of a result table."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.errors import UserError, suggestion
from ravenjax.outcomes.events import Rules
from ravenjax.report.data.facts import faulty_sql
from ravenjax.store import manifest
from ravenjax.store.access import query
from ravenjax.store.access.query import RESULTS, ResultTable, quoted, text


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


COMPARED = (
    "response",
    "hazard",
    "first_active_ms",
    "unintended_mm",
    "loss_mm",
    "tip_path_mm",
    "told_ms",
)
"""Columns that tell whether a run came out as it is stored."""


def faulty(folder: Path, group: str | None = None) -> list[int]:
    """Numbers of the valid rows with a fault, of a group or of all. Raises UserError for an unknown
    group or where there are none, StoreError as `query.open_folder`."""
    with query.open_folder(folder) as table:
        groups = [
            name
            for (name,) in table.rows(f'SELECT DISTINCT "group"::VARCHAR FROM {RESULTS} ORDER BY 1')
        ]
        if group is not None and group not in groups:
            raise UserError(
                f"--group {group!r}: unknown, expected"
                f" {', '.join(groups)}{suggestion(group, groups)}"
            )
        where = "true" if group is None else f'"group" = {text(group)}'
        condition = f"failed = '' AND {faulty_sql(list(table.types()))} AND {where}"
        rows = [
            row
            for (row,) in table.rows(f"SELECT row FROM {RESULTS} WHERE {condition} ORDER BY row")
        ]
    if not rows:
        place = f"{folder}" if group is None else f"group {group!r} of {folder}"
        raise UserError(f"{place}: no valid run with a fault, so there is nothing to explain")
    return rows


def changed(folder: Path, results: pd.DataFrame) -> int:
    """How many of these runs are stored with other outcomes; a run that is not stored is none of
    them.
    """
    names = [name for name in COMPARED if name in results]
    listed = ", ".join(map(str, results["index"].tolist()))
    with query.open_folder(folder) as table:
        columns = ", ".join(["row", *map(quoted, names)])
        stored = table.frame(f"SELECT {columns} FROM {RESULTS} WHERE row IN ({listed})").set_index(
            "row"
        )
    own = results.set_index("index").loc[stored.index, names]
    differs = np.zeros(len(own), bool)
    for name in names:
        before, after = stored[name], own[name]
        if before.dtype.kind == "f":
            differs |= ~np.isclose(before, after, rtol=0, atol=0, equal_nan=True)
        else:
            differs |= (before.astype(str) != after.astype(str)).to_numpy()
    return int(differs.sum())
