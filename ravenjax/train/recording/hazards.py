"""The hazards of a session: hazards.csv, or the rows that its recording tells of where it was
killed before it could write the table.
"""

from __future__ import annotations

import csv
import dataclasses
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from ravenjax.errors import StoreError
from ravenjax.train.judge.row import COLUMNS, TOLD, HazardRow
from ravenjax.train.recording.reader import Recording

FILE = "hazards.csv"
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


def read_table(folder: Path) -> list[HazardRow]:
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
    if missing := [name for name in COLUMNS if name not in columns]:
        raise StoreError(
            f"{path}: has no column {', '.join(missing)}; expected those that `ravenjax train`"
            " writes"
        )
    rows = []
    for number, line in enumerate(lines, start=2):
        try:
            rows.append(_hazard({name: line[name] or "" for name in COLUMNS}))
        except ValueError as error:
            raise StoreError(f"{path}: line {number}: {error}") from None
    return sorted(rows, key=lambda row: (row.struck_ms is None, row.struck_ms or 0.0, row.number))


def from_recording(recording: Recording, header: Mapping[str, Any]) -> list[HazardRow]:
    """A row for each hazard that was armed, in order of arming.

    Of a hazard that was at work when the recording broke off, the row says when it was armed and
    struck, and its outcome is empty.
    """
    scenario = header.get("scenario")
    table: dict[str, Any] = scenario if isinstance(scenario, dict) else {"name": scenario or ""}
    listed = {hazard.get("number"): hazard for hazard in header.get("hazards") or []}
    same = {name: header.get(name, "") for name in ("participant", "group", "seed", "blinded")}
    same |= {"session": header.get("name", ""), "scenario": table.get("name", "")}
    rows: list[dict[str, Any]] = []
    for event in recording.events:
        if event["kind"] == "hazard_armed":
            hazard = listed.get(event["number"], {})
            rows.append(
                same
                | {name: hazard.get(name, "") for name in ("hazard", "title")}
                | {"right_response": " ".join(hazard.get("right_response", []))}
                | {"number": event["number"], "armed_ms": event["tick"]}
                | {"cue": "on" if header.get("cue") else "off"}
                | {"limit_mm": (table.get("harm") or {}).get("excursion_mm")}
            )
        elif event["kind"] == "hazard_struck" and rows:
            rows[-1]["struck_ms"] = event["tick"]
        elif event["kind"] == "hazard_row" and rows:
            rows[-1] |= zip(TOLD, event["row"], strict=True)
    return [
        _hazard({name: "" if row.get(name) is None else str(row[name]) for name in COLUMNS})
        for row in rows
    ]


def as_csv(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Rows as CSV with these of their columns."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()


def _hazard(cells: dict[str, str]) -> HazardRow:
    values: dict[str, Any] = dict(cells)
    for field in dataclasses.fields(HazardRow):
        text = cells[field.name].strip()
        if field.type == "bool":
            values[field.name] = text.lower() in ("true", "1", "yes")
        elif field.type in ("int", "float | None"):
            try:
                number = float(text) if text else None
            except ValueError:
                raise ValueError(
                    f"{field.name} is {cells[field.name]!r}, expected a number or nothing"
                ) from None
            is_finite = number is not None and abs(number) < float("inf")
            values[field.name] = number if is_finite else None
    if values["number"] is None:
        raise ValueError("number is empty, expected the hazard's number in session.json")
    values["number"] = int(values["number"])
    return HazardRow(**values)
