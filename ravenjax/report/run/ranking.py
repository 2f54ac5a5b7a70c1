"""Ranks the runs of a result table from the worst outcome to the mildest."""

from pathlib import Path
from typing import NamedTuple

import pandas as pd

from ravenjax import resources
from ravenjax.errors import UserError, suggest_name
from ravenjax.outcomes import events
from ravenjax.outcomes.events import Rules
from ravenjax.report.data.facts import faulty_sql
from ravenjax.store import manifest
from ravenjax.store.access import query
from ravenjax.store.access.query import RESULTS, ResultTable, quote_name, quote_text


class Ranking(NamedTuple):
    """A measure by which one run is worse than another."""

    name: str
    sql: str
    unit: str
    meaning: str


_FILE = resources.read_tables(__file__, "rankings.toml")
RANKINGS = {name: Ranking(name, **measure) for name, measure in _FILE.items()}


class WorstRun(NamedTuple):
    """One run and its value in the ranking."""

    row: int
    run_id: str
    value: float  # in the ranking's unit


def worst_runs(folder: Path, count: int, by: str) -> list[WorstRun]:
    """Return the `count` worst valid runs with a fault, worst first, or fewer.

    Raises UserError for an unknown ranking or a number below 1; errors of `query.open_folder`.
    """
    if by not in RANKINGS:
        expected = f"{', '.join(RANKINGS)}{suggest_name(by, RANKINGS)}"
        raise UserError(f"--by {by}: unknown, expected {expected}")
    if count < 1:
        raise UserError(f"--worst {count}: expected a number of runs, 1 or more")
    rules: Rules = manifest.read_manifest(folder).rules
    value = f"({RANKINGS[by].sql.format(cue=rules.cue)})::DOUBLE"
    with query.open_folder(folder) as table:
        faulty = faulty_sql(list(table.types()))
        cases = f"{RESULTS} WHERE failed = '' AND {faulty} AND {value} > 0 AND NOT isnan({value})"
        return rank_runs(table, cases, value, count)


def rank_runs(table: ResultTable, cases: str, value: str, count: int) -> list[WorstRun]:
    """Return the `count` worst runs of a table.

    cases: SQL for the table. value: SQL for the measure, larger is worse.
    """
    rows = table.rows(
        f"SELECT row, run_id, {value} AS value FROM {cases} ORDER BY value DESC, row LIMIT {count}"
    )
    return [WorstRun(row, str(run_id), float(value)) for row, run_id, value in rows]


TEXT_COLUMNS = ("response", "hazard")
_NUMBERS = ("first_active_ms", "unintended_mm", "loss_mm", "tip_path_mm", "told_ms")
COMPARED_COLUMNS = TEXT_COLUMNS + _NUMBERS
"""Columns that are compared to decide whether two runs have the same outcome."""


def faulty_rows(folder: Path, group: str | None) -> list[int]:
    """Return the row numbers of valid runs with a fault.

    The list is empty if no fault evades the checks, because there is nothing to explain. group:
    name of one group, or None for all groups.

    Raises UserError for an unknown group or without such runs; errors of `query.open_folder`.
    """
    with query.open_folder(folder) as table:
        rows = table.rows(f'SELECT DISTINCT "group"::VARCHAR FROM {RESULTS} ORDER BY 1')
        groups = [name for (name,) in rows]
        if group is not None and group not in groups:
            expected = f"{', '.join(groups)}{suggest_name(group, groups)}"
            raise UserError(f"--group {group!r}: unknown, expected {expected}")
        where = "true" if group is None else f'"group" = {quote_text(group)}'
        condition = f"failed = '' AND {faulty_sql(list(table.types()))} AND {where}"
        evades_sql = events.event_sql("evades", Rules())
        rows = table.rows(f"SELECT row, {evades_sql} FROM {RESULTS} WHERE {condition} ORDER BY row")
    if not rows:
        place = f"{folder}" if group is None else f"group {group!r} of {folder}"
        raise UserError(f"{place} has no valid run with a fault, so no run can be explained")
    return [row for row, _ in rows] if any(evades for _, evades in rows) else []


def count_changed(folder: Path, results: pd.DataFrame) -> int:
    """Return how many of these runs have another outcome than the same runs in the folder."""
    names = [name for name in COMPARED_COLUMNS if name in results]
    rows = ", ".join(map(str, results["index"].tolist()))
    with query.open_folder(folder) as table:
        columns = ", ".join(["row", *map(quote_name, names)])
        stored = table.frame(f"SELECT {columns} FROM {RESULTS} WHERE row IN ({rows})")
        stored = stored.set_index("row")
    words = {name: str for name in TEXT_COLUMNS if name in names}
    computed = results.set_index("index").loc[stored.index, names].astype(words)
    stored = stored.astype(words)
    unchanged = (stored == computed) | (stored.isna() & computed.isna())
    return int((~unchanged.all(axis=1)).sum())
