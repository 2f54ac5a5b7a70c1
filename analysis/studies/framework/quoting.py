"""Numbers of findings in sentences: what a claim's texts name in braces, read from a record
(findings.json).
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from studies.framework import cells, targets
from studies.framework.claims import Quotation

Record = Mapping[str, Any]

ABSENT = "(not in these findings)"
"""Where the findings have no such line or cell; a test refuses it for those that are kept."""
NOT_PREDICTED = "(not predicted)"
"""Where a line has no prediction, as without a recording that is not in the repository."""

_UNITS = {"1/h": "an hour", "per hour": "an hour"}
"""Units as a sentence says them."""


class Quoted(NamedTuple):
    """A number as words."""

    text: str
    over: str = ABSENT  # what it was counted over
    published: str = ABSENT
    band: str = ABSENT  # of agreement

    def __str__(self) -> str:
        return self.text

    def __format__(self, spec: str) -> str:
        return format(self.text, spec)


def filled(text: str, numbers: Mapping[str, Quotation], record: Record | None) -> str:
    """The text with its numbers; without findings each is said to be absent."""
    return text.format_map({name: quoted(one, record) for name, one in numbers.items()})


def quoted(one: Quotation, record: Record | None) -> Quoted:
    """What the findings say at that place."""
    if record is None:
        return Quoted(ABSENT)
    if one.line:
        return _of_line(matching(one.line, record["lines"], "quantity"))
    if one.target:
        states = [state for state in targets.states(record["lines"]) if state.id == one.target]
        return Quoted(targets.sentence(states[0]) if states else ABSENT)
    if one.inside:
        judged = [line["passed"] for line in matching(one.inside, record["lines"], "quantity")]
        judged = [passed for passed in judged if passed is not None]
        return Quoted(f"{sum(judged)} of {len(judged)}" if judged else NOT_PREDICTED)
    return Quoted(_of_cell(one, record))


def matching(pattern: str, rows: Sequence[Record], key: str) -> list[Record]:
    """The rows whose text at `key` is as the pattern."""
    return [row for row in rows if _is(pattern, row[key])]


def _of_line(lines: Sequence[Record]) -> Quoted:
    if len(lines) != 1:
        return Quoted(ABSENT)
    (line,) = lines
    predicted, published = line["predicted"], line["published"]
    unit = _UNITS.get(str(line["unit"]), str(line["unit"]))
    return Quoted(
        NOT_PREDICTED if predicted is None else cells.with_interval(predicted, unit),
        NOT_PREDICTED if predicted is None else cells.counted_over(predicted),
        ABSENT if published is None else cells.with_interval(published, unit),
        ABSENT if line["band"] is None else cells.span(*line["band"]),
    )


def _of_cell(one: Quotation, record: Record) -> str:
    tables = matching(one.table, record["tables"], "title")
    if len(tables) != 1:
        return ABSENT
    columns = [k for k, name in enumerate(tables[0]["columns"]) if _is(one.column, name)]
    rows = [row for row in tables[0]["rows"] if all(map(_is, one.row, map(cells.cell, row)))]
    return cells.cell(rows[0][columns[0]]) if len(columns) == len(rows) == 1 else ABSENT


def _is(pattern: str, text: str) -> bool:
    return re.fullmatch(".*".join(map(re.escape, pattern.split("*"))), text, re.DOTALL) is not None
