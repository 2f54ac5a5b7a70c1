"""Reads and summarises the hazards of a session.

They come from hazards.csv. If the session was killed before it could write that table, they come
from the rows of its recording.
"""

import csv
import io
import statistics
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from ravenjax.errors import StoreError
from ravenjax.train.judge.episode import COLUMNS, HazardRow
from ravenjax.train.protocol import Json
from ravenjax.train.recording.reader import Recording

FILE = "hazards.csv"
LEFT_ROOM = ("avoided", "harm", "missed")
"""Outcomes of hazards that left room for a response; they alone have rates and mean scores."""
_ROWS = TypeAdapter(list[HazardRow])
_FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""Beginnings of a cell that a spreadsheet computes."""


def read_table(folder: Path) -> list[HazardRow]:
    """Return the hazards of a session's folder in the order of their activation.

    The list is empty if the folder has no hazards.csv. Raises StoreError if the file is damaged or
    lacks a column.
    """
    path = Path(folder) / FILE
    try:
        with open(path, newline="", encoding="utf-8") as file:
            reader = csv.DictReader(file, restkey="")
            columns = list(reader.fieldnames or [])
            lines = list(reader)
    except FileNotFoundError:
        return []
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise StoreError(f"{path}: cannot be read ({error})") from error
    if missing := [name for name in COLUMNS if name not in columns]:
        raise StoreError(
            f"{path} has no column {', '.join(missing)}; expected the columns that"
            " `ravenjax train` writes"
        )
    try:
        rows = _ROWS.validate_python(lines)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        number, column = first["loc"][:2]
        expected = first["msg"].removeprefix("Value error, ")
        raise StoreError(
            f"{path}: line {int(number) + 2}: {column} is {first['input']!r}, {expected}"
        ) from None
    return sorted(rows, key=lambda row: (row.struck_ms is None, row.struck_ms or 0.0, row.number))


def from_recording(recording: Recording, header: Json) -> list[HazardRow]:
    """Return a row for each hazard that was armed; the last has no outcome if it was cut short."""
    rows: list[Json] = []
    for event in recording.events:
        if event["kind"] == "hazard_armed":
            rows.append({**event["row"]})
        elif event["kind"] == "hazard_struck" and rows:
            rows[-1]["struck_ms"] = event["tick"]
        elif event["kind"] == "hazard_row" and rows:
            rows[-1] |= event["row"]
    return [HazardRow(**(session_columns(header) | row)) for row in rows]


def session_columns(header: Json) -> Json:
    """Return the columns that all hazards of a session share, from its session.json."""
    same = {name: header.get(name) for name in ("participant", "group", "seed", "blinded")}
    scenario = (header.get("scenario") or {}).get("name")
    return same | {"session": header.get("name"), "scenario": scenario}


def summarize_hazards(rows: Sequence[HazardRow]) -> Json:
    """Return numbers of a whole session; None where nothing was measured."""
    struck = [row for row in rows if row.struck_ms is not None]
    answerable = [row for row in struck if row.outcome in LEFT_ROOM]
    counts = {
        name: dict(Counter(word for row in rows if (word := getattr(row, name))))
        for name in ("outcome", "check_response", "motion_hazard")
    }

    def over(function: Callable[[list[float]], float], values: Iterable[float | None]) -> Any:
        known = [value for value in values if value is not None]
        return round(function(known), 1) if known else None

    return {
        "hazards": len(rows),
        "struck": len(struck),
        "outcomes": counts["outcome"],
        "check_responses": counts["check_response"],
        "motion_hazards": counts["motion_hazard"],
        "left_room": len(answerable),
        "right_responses": sum(row.response_ok for row in answerable),
        "median_reaction_ms": over(
            statistics.median, (row.reaction_ms for row in answerable if row.response_ok)
        ),
        "score": over(statistics.fmean, (row.score for row in answerable)),
        "farthest_mm": over(max, (row.farthest_mm for row in struck)),
        "deepest_mm": over(max, (row.deepest_mm for row in struck)),
    }


def _plain(value: Any) -> Any:
    return f"'{value}" if isinstance(value, str) and value.startswith(_FORMULA) else value


def as_csv(columns: Sequence[str], rows: Iterable[Json]) -> str:
    """Return the given columns of the rows as CSV. Text that a spreadsheet would take for a formula
    begins with an apostrophe.
    """
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: _plain(value) for name, value in row.items()})
    return out.getvalue()
