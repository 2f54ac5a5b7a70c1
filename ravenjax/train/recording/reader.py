"""Reads the recording of a session from its folder. Reads and summarises the session's hazards.

Hazards come from hazards.csv. If the session was killed before it wrote this table, they come from
the rows of the recording.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import statistics
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter, ValidationError

from ravenjax.errors import StoreError
from ravenjax.store.files import without_formula
from ravenjax.store.logs import mcap_records
from ravenjax.store.logs.session import description
from ravenjax.store.logs.session import log as session_log
from ravenjax.train.judge import COLUMNS, HazardRow
from ravenjax.train.protocol import FrameLayout, Json
from ravenjax.train.robot import ARMS


@dataclass(frozen=True)
class SessionFolder:
    """A session's folder and its session.json."""

    path: Path
    header: Json

    @property
    def order(self) -> tuple[str, str]:
        """A key by which sessions are in the order of their start."""
        return self.started, self.path.name

    @property
    def scenario(self) -> str:
        return (self.header.get("scenario") or {}).get("name") or ""

    @property
    def participant(self) -> str:
        """The participant; "" if not named."""
        return self.header.get("participant") or ""

    @property
    def started(self) -> str:
        """Time of the start, UTC, ISO 8601; "" if not known."""
        return self.header.get("started") or ""

    @property
    def summary(self) -> Json:
        """The summary that the session wrote when it ended."""
        return self.header.get("summary") or {}


def sessions_beside(base: Path) -> list[SessionFolder]:
    """Return the undamaged sessions in the folders of `base`, the first begun first."""
    sessions = []
    for file in sorted(Path(base).glob(f"*/{description.FILE}")):
        try:
            sessions.append(SessionFolder(file.parent, description.read_session(file.parent)))
        except StoreError:
            continue
    return sorted(sessions, key=lambda session: session.order)


TABLE = "hazards.csv"
LEFT_ROOM = ("avoided", "harm", "missed")
"""Outcomes of hazards that left room for a response; they alone have rates and mean scores."""
_ROWS = TypeAdapter(list[HazardRow])


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Recording(session_log.SessionLog):
    """The recording of a session."""

    layout: FrameLayout

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a channel over time: [T] or [T, k]."""
        values = self.rows[:, self.layout.places[name]]
        return values[:, 0] if values.shape[1] == 1 else values

    @cached_property
    def ms(self) -> np.ndarray:
        """Time of each row in ms since the session began, [T]."""
        return self["session_tick"].astype(float)

    @cached_property
    def began_ms(self) -> float:
        """When the session's time began, ms; 0 if it never did."""
        starts = (event["tick"] for event in self.events if event["kind"] == "started")
        return float(next(starts, 0.0))

    def without_pauses(self) -> Recording:
        """Return the rows in which the session's time ran, from its beginning on."""
        advances = np.diff(self.ms, append=self.ms[-1:] + 1) > 0
        runs = np.flatnonzero(advances & (self.ms >= self.began_ms))
        # Without a pause this is no copy.
        whole = slice(runs[0], runs[-1] + 1) if runs[-1] - runs[0] == len(runs) - 1 else runs
        return dataclasses.replace(self, rows=self.rows[whole], numbers=self.numbers[whole])

    def worst(self, name: str, arms: Sequence[str]) -> np.ndarray:
        """Return the greatest of the arms' values [T]. The value of a vector is its length."""
        channels = [self[f"{arm}/{name}"] for arm in arms]
        sizes = [np.linalg.norm(x, axis=1) if x.ndim > 1 else x for x in channels]
        return np.max(sizes, axis=0)


def find_recording(folder: Path) -> Path | None:
    """Return the recording of a session's folder, preferably the recovered one, or None."""
    file = Path(folder) / session_log.FILE
    return next((path for path in (mcap_records.recovered_path(file), file) if path.exists()), None)


def read_recording(path: Path, channels: Collection[str] = ()) -> Recording:
    """Read a recording, complete or cut short, from a file or a session's folder.

    channels: those to read, without their arms, such as "tip"; none: all. Raises StoreError if the
    folder has no recording, or its channels are those of another version.
    """
    path = Path(path)
    if path.is_dir():
        if (file := find_recording(path)) is None:
            raise StoreError(
                f"{path} has no {session_log.FILE}; give the folder of a recorded session"
            )
        path = file

    def keeps(name: str) -> bool:
        return not channels or name.rstrip("/0123456789").rpartition("/")[2] in channels

    log = session_log.read_session_log(path, keeps)
    layout = FrameLayout.of([arm for arm in ARMS if f"{arm}/jpos/0" in log.names])
    if layout.names() != log.names:
        raise StoreError(
            f"{path} was recorded with other channels; read it with the version of ravenjax that"
            " session.json names"
        )
    return Recording(**vars(log), layout=layout.of_channels(keeps))


def read_table(folder: Path) -> list[HazardRow]:
    """Return the hazards of a session's folder in the order of their activation.

    The list is empty if the folder has no hazards.csv. Raises StoreError if the file is damaged or
    lacks a column.
    """
    path = Path(folder) / TABLE
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
    empty: Json = dict.fromkeys(COLUMNS) | session_columns(header)
    return [HazardRow(**(empty | row)) for row in rows]


def session_columns(header: Json) -> Json:
    """Return the columns that all hazards of a session share, from its session.json."""
    same = {name: header.get(name) for name in ("participant", "group", "seed", "blinded")}
    scenario = header.get("scenario") or {}
    return same | {"session": header.get("name"), "scenario": scenario.get("name")}


def summarize_hazards(rows: Sequence[HazardRow]) -> Json:
    """Return numbers of a whole session; None where nothing was measured."""
    struck = [row for row in rows if row.struck_ms is not None]
    answerable = [row for row in struck if row.outcome in LEFT_ROOM]
    right = [row for row in answerable if row.response_ok]

    def count(name: str) -> dict[str, int]:
        return dict(Counter(word for row in rows if (word := getattr(row, name))))

    def over(function: Any, name: str, among: Sequence[HazardRow]) -> Any:
        known = [value for row in among if (value := getattr(row, name)) is not None]
        return round(function(known), 1) if known else None

    return {
        "hazards": len(rows),
        "struck": len(struck),
        "outcomes": count("outcome"),
        "check_responses": count("check_response"),
        "motion_hazards": count("motion_hazard"),
        "left_room": len(answerable),
        "right_responses": len(right),
        "median_reaction_ms": over(statistics.median, "reaction_ms", right),
        "score": over(statistics.fmean, "score", answerable),
        "farthest_mm": over(max, "farthest_mm", struck),
        "deepest_mm": over(max, "deepest_mm", struck),
    }


def as_csv(columns: Sequence[str], rows: Iterable[Json]) -> str:
    """Return the columns of the rows as CSV, with formulas made harmless by an apostrophe."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: without_formula(value) for name, value in row.items()})
    return out.getvalue()
