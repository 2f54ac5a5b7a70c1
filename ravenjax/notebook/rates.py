"""Computes rates of events in a result, counting each distinct fault once, as in the report."""

from collections.abc import Sequence

import pandas as pd

from ravenjax.errors import UserError, describe_unknown_name, format_value, suggest_name
from ravenjax.outcomes import events
from ravenjax.outcomes.events import Rules
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables
from ravenjax.store.access.query import RESULTS, quote_name

_FACTS = ("group", "site", "layer", "block", "response", "hazard", "outcome")
"""Columns of the table `facts` by which the report groups faults."""
_PREFIXES = ("", "fault0_", "param:")
"""Prefixes of columns that a user may leave out: of the first fault, and of parameters."""
NUMBERS = ("event", "k", "n", "rate", "low", "high")
"""Columns of the result, after the columns that define classes."""


def rates(runs: Runs, rules: Rules, names: Sequence[str], by: Sequence[str]) -> pd.DataFrame:
    """Return a row per event and class of faults, with the columns `by`, then NUMBERS.

    Classes that are words have the order of their rates, the largest first. n counts distinct
    faults: for each, the first valid run without a reaction of the operator. low and high are the
    95 % Wilson interval, NaN for enumerated faults. Raise UserError for an unknown event or column.
    """
    keys = {name: _column(runs, name) for name in by}
    event_columns = [
        f"({_event(runs, name, rules)})::BOOLEAN AS event{number}"
        for number, name in enumerate(names)
    ]
    # A line has the values of `by`, the number of faults, their groups, and a count of each event.
    columns = [
        *(f"{column} AS key{number}" for number, column in enumerate(keys.values())),
        "count(*)",
        'list(DISTINCT f."group"::VARCHAR)',
        *(f"count(*) FILTER (r.event{number})" for number in range(len(names))),
    ]
    lines = runs.table.rows(
        f"SELECT {', '.join(columns)} FROM (SELECT *, {', '.join(event_columns)} FROM {RESULTS}) r"
        f" JOIN {FACTS} f ON r.row = f.row WHERE f.sample AND f.faulty GROUP BY ALL ORDER BY ALL"
    )
    rows = []
    for number, name in enumerate(names):
        rates_of_event = []
        for line in lines:
            n, groups, *counts = line[len(by) :]
            rate = tables.fault_share(runs, counts[number], n, groups)
            rates_of_event.append((line[: len(by)], rate))
        # All columns are words: those of the table `facts`, and texts of the result table.
        if all(column.startswith("f.") or column.endswith("::VARCHAR") for column in keys.values()):
            rates_of_event.sort(key=lambda item: -item[1].value)
        rows += [(*classes, name, *rate) for classes, rate in rates_of_event]
    return pd.DataFrame(rows, columns=[*by, *NUMBERS])


def as_list(value: object, what: str) -> list[str]:
    """Return one or several texts as a list. what: name of the argument, for UserError."""
    texts = [value] if isinstance(value, str) else value
    if not isinstance(texts, Sequence) or not all(isinstance(text, str) for text in texts):
        raise UserError(f"{what} is {format_value(value)}, expected a text or a list of texts")
    return list(texts)


def _event(runs: Runs, name: str, rules: Rules) -> str:
    # Returns the SQL condition of an event, or raises UserError if the results do not contain it.
    if name not in events.EVENTS:
        raise UserError(describe_unknown_name("event", name, events.EVENTS))
    for column in events.event_columns([name], rules):
        # Only `cable_overload_first_ms` may be absent, where cable tensions are unknown.
        if column.endswith("_ms") and column not in runs.names:
            raise UserError(f"got event {name!r}, {events.UNWATCHED}")
    return events.event_sql(name, rules)


def _column(runs: Runs, name: str) -> str:
    # Returns SQL for a column, whose name may lack one of _PREFIXES. f: facts, r: results.
    if name in _FACTS and name in runs.facts:
        return f"f.{quote_name(name)}::VARCHAR"
    for prefix in _PREFIXES:
        if f"{prefix}{name}" in runs.types:
            is_text = runs.types[f"{prefix}{name}"].startswith(("VARCHAR", "ENUM"))
            return f"r.{quote_name(prefix + name)}" + ("::VARCHAR" if is_text else "")
    names = [*_FACTS, *(column.removeprefix("fault0_") for column in runs.names)]
    raise UserError(
        f"by {name!r}: no such column, expected one of {', '.join(_FACTS)}, a key of a fault, the"
        f" path of a varied parameter or a column of the result table{suggest_name(name, names)}"
    )
