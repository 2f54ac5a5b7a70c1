"""Parses the outcome that a search examines: a number of the result table, or an event.

A text has one of these forms:

- `peak_model_deviation_mm`: a number, from the column of this name;
- `evades`: an event of `ravenjax.outcomes.events`, with the limits of the search's campaign;
- `jump_code`: an event, from a column of truth values;
- `peak_model_deviation_mm >= 3`: an event, if the number is at least the limit; also <=;
- `response = stopped`: an event, if the column has this word.
"""

import contextlib
import dataclasses
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa

from ravenjax.bundled import resources
from ravenjax.errors import format_value, suggest_name
from ravenjax.outcomes import events, verdict
from ravenjax.outcomes.events import Rules
from ravenjax.store import schema

_FORM = re.compile(r"^\s*(\w+)\s*(?:(>=|<=|=)\s*(.*?)\s*)?$")
_TIMES = ("first_ms", "last_ms", "first_active_ms", "response_ms", "reaction_ms", "told_ms")
"""Endings of the names of columns that have -1 if the event never happened."""
_GIVEN = re.compile(r"(run_id|index|group|seed|operator)$|fault\d+_|param:")
"""Columns that are inputs of a run, not outcomes."""

_WORDS = {"verdict": verdict.VERDICTS, "response": verdict.RESPONSES, "hazard": verdict.HAZARDS}
"""Columns of words, with all possible words."""

FORMS = (
    "'peak_model_deviation_mm', 'evades', 'jump_code', 'peak_model_deviation_mm >= 3' or 'response"
    " = stopped'"
)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """One number per run: the value of a column, or 1 if the event happened and 0 if not."""

    column: str
    relation: str = ""  # ">=", "<=", "=", or "" for the column itself
    bound: float = 0.0
    word: str = ""  # the word after "="

    def __str__(self) -> str:
        if not self.relation:
            return self.column
        return f"{self.column} {self.relation} {self.word or f'{self.bound:g}'}"

    @property
    def unit(self) -> str:
        """Return the unit of the column."""
        return (
            self.column.rpartition("_")[2]
            if self.column.endswith(("_mm", "_ms")) and not self.relation
            else ""
        )

    @property
    def named_event(self) -> bool:
        """Return whether the outcome is an event of `ravenjax.outcomes.events`."""
        return not self.relation and self.column in events.EVENTS

    def columns(self, rules: Rules) -> list[str]:
        """Return the columns of the result table that `values` and `margins` need."""
        if self.named_event:
            return events.event_columns([self.column], rules)
        return [self.column, "failed"]

    def values(self, columns: pd.DataFrame, rules: Rules) -> np.ndarray:
        """Return the outcome of each run, float64 [rows].

        It is NaN if the run failed or has no such number.
        """
        if self.named_event:
            table = pa.Table.from_pandas(columns[self.columns(rules)], preserve_index=False)
            valid, cases = events.events_happened(table, [self.column], rules)
            return np.where(valid, cases.astype(np.float64), np.nan)
        if self.word:
            values = np.asarray(pd.Categorical(columns[self.column]) == self.word, np.float64)
        elif self.relation:
            margins = self.margins(columns)
            absent = np.nan if not self._may_be_absent else 0.0
            values = np.where(np.isnan(margins), absent, margins >= 0)
        else:
            values = self._numbers(columns)
        return np.where(columns["failed"] == "", values, np.nan)

    def margins(self, columns: schema.Columns) -> np.ndarray:
        """Return the distance of the column beyond its limit, float64 [rows].

        The event happened if the distance is at least 0.
        """
        beyond = self._numbers(columns) - self.bound
        margins = beyond if self.relation == ">=" else -beyond
        return np.where(np.asarray(columns["failed"] == ""), margins, np.nan)

    @property
    def _may_be_absent(self) -> bool:
        return self.column.endswith(_TIMES)

    def _numbers(self, columns: schema.Columns) -> np.ndarray:
        numbers = np.asarray(columns[self.column]).astype(np.float64)
        # The time of an event that never came is -1.
        return np.where(numbers < 0, np.nan, numbers) if self._may_be_absent else numbers

    def complaints(self, shape: schema.Shape) -> list[str]:
        """Return the mistakes of this outcome for a result table of this shape."""
        dtypes = {
            column.name: column.dtype
            for column in schema.table_columns(shape)
            if not _GIVEN.match(column.name)
        }
        return resources.render_text(
            Path(__file__).with_name("outcome_errors.j2"),
            outcome=self,
            shape=shape,
            dtypes=dtypes,
            events=events,
            words=_WORDS.get(self.column, ()),
            may_be_absent=self._may_be_absent,
            suggest_name=suggest_name,
        ).splitlines()


def parse_outcome(text: str) -> Outcome:
    """Parse a text such as "response = stopped". Raise ValueError for any other form."""
    if match := _FORM.match(text):
        column, relation, right = match[1], match[2] or "", match[3] or ""
        if relation == "=" and right:
            return Outcome(column, relation, word=right)
        if not relation:
            return Outcome(column)
        with contextlib.suppress(ValueError):
            return Outcome(column, relation, float(right))
    raise ValueError(f"got {format_value(text)}, expected a column or an event, such as {FORMS}")


def require_event(text: str) -> str:
    """Return `text`. Raise ValueError if it names a number, not an event."""
    found = parse_outcome(text)
    truths = {c.name for c in schema.table_columns(schema.Shape()) if c.dtype == "bool"}
    if not (found.relation or found.named_event or found.column in truths):
        raise ValueError(
            f"got {format_value(text)}, which is a number; expected an event, such as '{text} >= 1'"
        )
    return text


def require_margin(text: str) -> str:
    """Return `text`. Raise ValueError unless it compares a column with a number."""
    outcome = parse_outcome(text)
    if outcome.relation not in (">=", "<=") or outcome.column.endswith(_TIMES):
        raise ValueError(
            f"got {format_value(text)}, expected a column and its limit, such as"
            " 'peak_model_deviation_mm >= 10', because the search uses the distance from the limit"
        )
    return text
