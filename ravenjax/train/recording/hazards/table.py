"""hazards.csv read back: one row for each hazard of a session; its columns are described in
`judge.episode`.
"""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ravenjax.errors import StoreError
from ravenjax.train.judge.row import HazardRow

FILE = "hazards.csv"
NUMBERS = tuple(one.name for one in dataclasses.fields(HazardRow) if one.type == "float | None")
"""Columns of numbers, each of which may be empty."""
OUTCOMES = {
    "avoided": "no harm was done",
    "harm": "harm was done",
    "unavoidable": "harm was done before anyone could have acted",
    "halted": "the robot halted by itself",
    "unaffected": "the instrument was hardly affected",
    "missed": "it passed without the right response",
    "interrupted": "it was cut off, and not by the operator: it is not scored",
}
"""How a hazard may end, in words."""


def read(folder: Path) -> list[HazardRow]:
    """Hazards of a session's folder in the order of their strike; none where it has no hazards.csv.

    Raises StoreError where the file is damaged or lacks a column.
    """
    path = Path(folder) / FILE
    try:
        with open(path, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file)
            columns = list(reader.fieldnames or [])
            lines = list(reader)
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise StoreError(f"{path}: cannot be read ({error})") from error
    wanted = [one.name for one in dataclasses.fields(HazardRow)]
    if missing := [name for name in wanted if name not in columns]:
        raise StoreError(
            f"{path}: has no column {', '.join(missing)}; expected those that `ravenjax train`"
            " writes"
        )
    rows = [
        _hazard(path, i + 2, {name: line[name] or "" for name in wanted})
        for i, line in enumerate(lines)
    ]
    return sorted(rows, key=lambda one: (one.struck_ms is None, one.struck_ms or 0.0, one.number))


def text(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Rows as CSV with these of their columns."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def _hazard(path: Path, line: int, cells: dict[str, str]) -> HazardRow:
    values: dict[str, object] = dict(cells)
    for name in NUMBERS:
        values[name] = _number(path, line, name, cells[name])
    for name in ("response_ok", "halted", "blinded"):
        values[name] = cells[name].strip().lower() in ("true", "1", "yes")
    number = _number(path, line, "number", cells["number"])
    if number is None:
        raise StoreError(
            f"{path}: line {line}: number is empty, expected the hazard's number in session.json"
        )
    values["number"] = int(number)
    return HazardRow(**values)  # type: ignore[arg-type]


def _number(path: Path, line: int, name: str, text: str) -> float | None:
    try:
        value = float(text) if text.strip() else None
    except ValueError:
        raise StoreError(
            f"{path}: line {line}: {name} is {text!r}, expected a number or nothing"
        ) from None
    return value if value is None or abs(value) < float("inf") else None
