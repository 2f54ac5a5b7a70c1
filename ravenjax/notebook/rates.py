"""Computes rates of events over the distinct faults of a result, counted as in the report."""

from collections.abc import Sequence

import pandas as pd

from ravenjax.errors import UserError, describe_unknown_name, format_value, suggest_name
from ravenjax.outcomes import events
from ravenjax.outcomes.events import Rules
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.store.access.query import RESULTS, quote_name

_WORDS = ("group", "site", "layer", "block", "response", "hazard", "outcome")
"""Columns of `facts` by which the report groups faults."""
_PREFIXES = ("", "fault0_", "param:")
"""Prefixes that a name may lack: "fault0_" for the first fault, "param:" for a parameter."""
NUMBERS = ("event", "k", "n", "rate", "low", "high")
"""Columns of the result, after those that the rates are grouped by."""


def rates(runs: Runs, rules: Rules, names: Sequence[str], by: Sequence[str]) -> pd.DataFrame:
    """Return a row per event and class of faults: columns `by`, then NUMBERS.

    If classes are words, those with the largest rate come first. n counts distinct faults: the
    first valid run of each in which nobody reacts. low and high are the 95 % Wilson interval, NaN
    for classes whose faults were enumerated. Raises UserError for an unknown event or column.
    """
    keys = {name: _column(runs, name) for name in by}
    marks = [
        f"({_event(runs, name, rules)})::BOOLEAN AS event{place}"
        for place, name in enumerate(names)
    ]
    columns = [
        *(f"{column} AS key{place}" for place, column in enumerate(keys.values())),
        "count(*)",
        'list(DISTINCT f."group"::VARCHAR)',
        *(f"count(*) FILTER (r.event{place})" for place in range(len(names))),
    ]
    lines = runs.table.rows(
        f"SELECT {', '.join(columns)} FROM (SELECT *, {', '.join(marks)} FROM {RESULTS}) r JOIN"
        f" {FACTS} f ON r.row = f.row WHERE f.sample AND f.faulty GROUP BY ALL ORDER BY ALL"
    )
    rows = []
    for place, name in enumerate(names):
        for line in lines:
            n, groups, *counts = line[len(by) :]
            rate = tables.fault_share(runs, k := counts[place], n, groups)
            rows.append((*line[: len(by)], name, k, n, rate.value, rate.low, rate.high))
        if all(column.startswith("f.") or column.endswith("::VARCHAR") for column in keys.values()):
            rows[-len(lines) :] = sorted(rows[len(rows) - len(lines) :], key=lambda row: -row[-3])
    return pd.DataFrame(rows, columns=[*by, *NUMBERS])


def as_list(value: object, what: str) -> list[str]:
    """Return one text or several as a list. Raises UserError for anything else."""
    several = [value] if isinstance(value, str) else value
    if not isinstance(several, Sequence) or not all(isinstance(one, str) for one in several):
        raise UserError(f"{what} is {format_value(value)}, expected a text or a list of texts")
    return list(several)


def _event(runs: Runs, name: str, rules: Rules) -> str:
    if name not in events.EVENTS:
        raise UserError(describe_unknown_name("event", name, events.EVENTS))
    for column in events.event_columns([name], rules):
        if column.endswith("_ms") and column not in runs.names:
            raise UserError(f"got event {name!r}, {events.UNWATCHED}")
    return events.event_sql(name, rules)


def _column(runs: Runs, name: str) -> str:
    # Returns SQL for a column by its name, or by the short name of a fault's key.
    if name in _WORDS and name in runs.facts:
        return f"f.{quote_name(name)}::VARCHAR"
    for prefix in _PREFIXES:
        if f"{prefix}{name}" in runs.types:
            words = runs.types[f"{prefix}{name}"].startswith(("VARCHAR", "ENUM"))
            return f"r.{quote_name(prefix + name)}" + ("::VARCHAR" if words else "")
    names = [*_WORDS, *(one.removeprefix("fault0_") for one in runs.names)]
    raise UserError(
        f"by {name!r}: no such column, expected {', '.join(_WORDS)}, a key of a fault, the path of"
        f" a varied parameter or a column of the result table{suggest_name(name, names)}"
    )
