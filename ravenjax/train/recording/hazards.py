"""The hazards of a session: hazards.csv, or the rows that its recording tells of where it was
killed before it could write the table.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from ravenjax.errors import StoreError
from ravenjax.train.judge.row import COLUMNS, OF_LIST, HazardRow
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
            cells: dict[str, Any] = {name: line[name] for name in COLUMNS}
            rows.append(HazardRow(**cells))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            cell = f"{first['loc'][0]} is {first['input']!r}"
            expected = first["msg"].removeprefix("Value error, ")
            raise StoreError(f"{path}: line {number}: {cell}, {expected}") from None
    return sorted(rows, key=lambda row: (row.struck_ms is None, row.struck_ms or 0.0, row.number))


def from_recording(recording: Recording, header: Mapping[str, Any]) -> list[HazardRow]:
    """A row for each hazard that was armed, in order of arming.

    Of a hazard that was at work when the recording broke off, the row says when it was armed and
    struck, and its outcome is empty.
    """
    scenario = header.get("scenario")
    table: dict[str, Any] = scenario if isinstance(scenario, dict) else {"name": scenario or ""}
    listed = {hazard.get("number"): hazard for hazard in header.get("hazards") or []}
    same = {name: header.get(name) for name in ("participant", "group", "seed", "blinded")}
    same |= {"session": header.get("name"), "scenario": table.get("name")}
    same |= {"cue": "on" if header.get("cue") else "off"}
    same |= {"limit_mm": (table.get("harm") or {}).get("excursion_mm")}
    rows: list[dict[str, Any]] = []
    for event in recording.events:
        if event["kind"] == "hazard_armed":
            hazard = listed.get(event["number"], {})
            known = {name: hazard.get(name) for name in OF_LIST}
            known["right_response"] = " ".join(hazard.get("right_response", []))
            rows.append(same | known | {"number": event["number"], "armed_ms": event["tick"]})
        elif event["kind"] == "hazard_struck" and rows:
            rows[-1]["struck_ms"] = event["tick"]
        elif event["kind"] == "hazard_row" and rows:
            rows[-1] |= event["row"]
    return [HazardRow(**row) for row in rows]


def as_csv(columns: Sequence[str], rows: Iterable[Mapping[str, Any]]) -> str:
    """Rows as CSV with these of their columns."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return out.getvalue()
