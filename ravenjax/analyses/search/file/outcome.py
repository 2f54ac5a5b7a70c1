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

from ravenjax import resources
from ravenjax.errors import format_value, suggest_name
from ravenjax.outcomes import events, verdict
from ravenjax.outcomes.events import Rules
from ravenjax.store import schema

_FORM = re.compile(r"^\s*(\w+)\s*(?:(>=|<=|=)\s*(.*?)\s*)?$")
_TIMES = ("first_ms", "last_ms", "first_active_ms", "response_ms", "reaction_ms", "told_ms")
"""Endings of the names of columns that have -1 if the event never happened."""
_INPUTS = re.compile(r"(run_id|index|group|seed|operator)$|fault\d+_|param:")
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
        """The unit of a column of mm or ms; "" for other columns and for events."""
        if self.relation or not self.column.endswith(("_mm", "_ms")):
            return ""
        return self.column.rpartition("_")[2]

    @property
    def named_event(self) -> bool:
        """Whether the outcome is an event of `ravenjax.outcomes.events`."""
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
            valid, happened = events.events_happened(table, [self.column], rules)
            return np.where(valid, happened.astype(np.float64), np.nan)
        if self.word:
            values = np.asarray(pd.Categorical(columns[self.column]) == self.word, np.float64)
        elif self.relation:
            margins = self.margins(columns)
            # A time that is absent is an event that never happened.
            without_margin = 0.0 if self._may_be_absent else np.nan
            values = np.where(np.isnan(margins), without_margin, margins >= 0)
        else:
            values = self._numbers(columns)
        return np.where(columns["failed"] == "", values, np.nan)

    def margins(self, columns: schema.Columns) -> np.ndarray:
        """Return how far the column is beyond its limit, float64 [rows]; negative: within it.

        The event happened if the result is at least 0. It is NaN for a failed run.
        """
        excess = self._numbers(columns) - self.bound
        margins = excess if self.relation == ">=" else -excess
        return np.where(np.asarray(columns["failed"] == ""), margins, np.nan)

    @property
    def _may_be_absent(self) -> bool:
        return self.column.endswith(_TIMES)

    def _numbers(self, columns: schema.Columns) -> np.ndarray:
        numbers = np.asarray(columns[self.column]).astype(np.float64)
        # The time of an event that never happened is -1.
        return np.where(numbers < 0, np.nan, numbers) if self._may_be_absent else numbers

    def complaints(self, shape: schema.Shape) -> list[str]:
        """Return messages on mistakes, such as a column that tables of this shape do not have, from
        the template `outcome_errors.j2`. Inputs of a run cannot be outcomes.
        """
        dtypes = {
            column.name: column.dtype
            for column in schema.table_columns(shape)
            if not _INPUTS.match(column.name)
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
    """Return the outcome of a text such as "response = stopped". Raises ValueError."""
    if match := _FORM.match(text):
        column, relation, limit = match[1], match[2] or "", match[3] or ""
        if relation == "=" and limit:
            return Outcome(column, relation, word=limit)
        if not relation:
            return Outcome(column)
        # A limit that is no number leads to the error below.
        with contextlib.suppress(ValueError):
            return Outcome(column, relation, float(limit))
    raise ValueError(f"got {format_value(text)}, expected a column or an event, such as {FORMS}")


def require_event(text: str) -> str:
    """Return `text`. Raise ValueError if it names a number, not an event."""
    outcome = parse_outcome(text)
    columns = schema.table_columns(schema.Shape())
    truth_columns = {column.name for column in columns if column.dtype == "bool"}
    if not (outcome.relation or outcome.named_event or outcome.column in truth_columns):
        raise ValueError(
            f"got {format_value(text)}, which is a number; expected an event, such as '{text} >= 1'"
        )
    return text


def require_margin(text: str) -> str:
    """Return `text`. Raise ValueError unless it limits a column, not a time, by >= or <=."""
    outcome = parse_outcome(text)
    if outcome.relation not in (">=", "<=") or outcome.column.endswith(_TIMES):
        raise ValueError(
            f"got {format_value(text)}, expected a column and its limit, such as"
            " 'peak_model_deviation_mm >= 10', because the search uses the distance from the limit"
        )
    return text
