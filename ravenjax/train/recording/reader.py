"""Reads what a training session wrote into its folder: the recording and the table of hazards.

If the session was killed before it wrote hazards.csv, the hazards are read from its events.
"""

import contextlib
import csv
import dataclasses
import io
import math
import statistics
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from functools import cached_property
from pathlib import Path

import numpy as np
from pydantic import TypeAdapter, ValidationError

from ravenjax.errors import StoreError
from ravenjax.store.files import without_formula
from ravenjax.store.logs import mcap_records
from ravenjax.store.logs.session import description
from ravenjax.store.logs.session import log as session_log
from ravenjax.train.judge import COLUMNS, TIMES, HazardRow
from ravenjax.train.protocol import FrameLayout, Json
from ravenjax.train.robot import ARMS


@dataclasses.dataclass(frozen=True)
class SessionFolder:
    """A session's folder and its session.json."""

    path: Path
    header: Json

    @property
    def order(self) -> tuple[str, str]:
        """A key that sorts sessions by their start, and those of the same time by name."""
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


def find_sessions(base: Path) -> dict[str, SessionFolder]:
    """Return the sessions in the subfolders of `base`: {folder's name: session}, earliest first.
    Folders without a readable session.json are left out.
    """
    sessions = []
    for file in Path(base).glob(f"*/{description.FILE}"):
        with contextlib.suppress(StoreError):
            sessions.append(SessionFolder(file.parent, description.read_session(file.parent)))
    sessions.sort(key=lambda session: session.order)
    return {session.path.name: session for session in sessions}


TABLE = "hazards.csv"
LEFT_ROOM = ("avoided", "harm", "missed")
"""Outcomes of hazards that left room for a response. Rates and mean scores count only these."""
_ROWS = TypeAdapter(list[HazardRow])


@dataclasses.dataclass(frozen=True, eq=False, kw_only=True)
class Recording(session_log.SessionLog):
    """The recording of a session, with access to channels by name."""

    layout: FrameLayout

    def __getitem__(self, name: str) -> np.ndarray:
        """Return a channel over time: [T] or [T, k]."""
        values = self.rows[:, self.layout.places[name]]
        return values[:, 0] if values.shape[1] == 1 else values

    @cached_property
    def ms(self) -> np.ndarray:
        """Time of each row in ms since the session's time began, [T]; below 0 before it."""
        return self["session_tick"].astype(float) - self.began_ms

    @cached_property
    def began_ms(self) -> float:
        """When the session's time began, in ms since the first row; 0 if it never began."""
        starts = (event["tick"] for event in self.events if event["kind"] == "started")
        return float(next(starts, 0.0))

    def without_pauses(self) -> "Recording":
        """Return a recording of the rows in which the session's time ran, from its beginning on."""
        # In a pause, rows have the time of the row that follows. The last row always counts.
        advances = np.diff(self.ms, append=self.ms[-1:] + 1) > 0
        kept = np.flatnonzero(advances & (self.ms >= 0))
        # A slice avoids a copy of the rows if there was no pause.
        has_pause = kept[-1] - kept[0] != len(kept) - 1
        selection = kept if has_pause else slice(kept[0], kept[-1] + 1)
        return dataclasses.replace(self, rows=self.rows[selection], numbers=self.numbers[selection])

    def greatest_of_arms(self, name: str, arms: Sequence[str]) -> np.ndarray:
        """Return the greatest value of a channel among these arms, [T]; of a vector, its length."""
        channels = [self[f"{arm}/{name}"] for arm in arms]
        values = [np.linalg.norm(x, axis=1) if x.ndim > 1 else x for x in channels]
        return np.max(values, axis=0)


def read_recording(folder: Path, channels: Collection[str] = ()) -> "Recording | None":
    """Read the recording in a session's folder, complete or cut short; None if there is none. A
    recovered recording is preferred. channels: names of channels to read, without the arm, such as
    "tip"; empty: all. Raises StoreError if another version of ravenjax wrote the recording.
    """
    file = Path(folder) / session_log.FILE
    files = (mcap_records.recovered_path(file), file)
    path = next((path for path in files if path.exists()), None)
    if path is None:
        return None

    def keeps(name: str) -> bool:
        # A name in a recording is like gold/tip/0, and its channel is "tip".
        return not channels or name.rstrip("/0123456789").rpartition("/")[2] in channels

    log = session_log.read_session_log(path, keeps)
    layout = FrameLayout.of(tuple(arm for arm in ARMS if f"{arm}/jpos/0" in log.names))
    # The log has the names of all numbers, also of those that it did not keep.
    if layout.names() != log.names:
        raise StoreError(
            f"{path} was recorded by another version of ravenjax, with other channels; read it with"
            " the version that session.json names"
        )
    return Recording(**vars(log), layout=layout.of_channels(keeps))


def read_table(folder: Path) -> list[HazardRow]:
    """Return the hazards in a session's folder, in the order of the file. The list is empty if the
    folder has no hazards.csv. Raises StoreError if the file is damaged or lacks a column.
    """
    path = Path(folder) / TABLE
    try:
        with open(path, newline="", encoding="utf-8") as file:
            # Surplus fields get the key "" and are ignored. `_ROWS` refuses the default, None.
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
        return _ROWS.validate_python(lines)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        number, column = first["loc"][:2]
        expected = first["msg"].removeprefix("Value error, ")
        # The header is line 1, and rows are counted from 0.
        raise StoreError(
            f"{path}: line {int(number) + 2}: {column} is {first['input']!r}, {expected}"
        ) from None


def from_recording(recording: "Recording", header: Json) -> list[HazardRow]:
    """Return a row for each hazard that was armed, from the events of a recording. A hazard that
    had not ended when the recording was cut short has no outcome. header: content of session.json.
    """
    rows: list[Json] = []
    for event in recording.events:
        match event["kind"]:
            case "hazard_armed":
                rows.append({**event["row"]})
            case "hazard_struck" if rows:
                rows[-1]["struck_ms"] = event["tick"]
            # All columns, once the hazard is over.
            case "hazard_row" if rows:
                rows[-1] |= event["row"]
    empty: Json = dict.fromkeys(COLUMNS) | session_columns(header)
    return [HazardRow(**(empty | row)) for row in number_hazards(rows, recording.began_ms)]


def number_hazards(rows: list[Json], began_ms: float) -> list[Json]:
    """Return the rows of `Judge.rows` as in hazards.csv and the debrief: in the order of their
    activation, numbered from 1, with times since tick `began_ms`, when the session's time began.
    """
    rows.sort(key=lambda row: row.get("struck_ms") or math.inf)
    for number, row in enumerate(rows, 1):
        row["number"] = number
        row |= {name: row[name] - began_ms for name in TIMES if row.get(name) is not None}
    return rows


def session_columns(header: Json) -> Json:
    """Return the columns that all hazards of a session share, from its session.json."""
    shared = {name: header.get(name) for name in ("participant", "group", "seed", "blinded")}
    scenario = header.get("scenario") or {}
    return shared | {"session": header.get("name"), "scenario": scenario.get("name")}


def summarize_hazards(rows: Sequence[HazardRow]) -> Json:
    """Return counts, medians and extremes of a session's hazards, for session.json and the page.
    Rates and scores are of hazards that left room for a response. None: no hazard has the value.
    """
    activated = [row for row in rows if row.struck_ms is not None]
    answerable = [row for row in activated if row.outcome in LEFT_ROOM]
    right = [row for row in answerable if row.response_ok]

    def count(name: str) -> dict[str, int]:
        # How often each word occurs in this column. Empty fields are not counted.
        return dict(Counter(word for row in rows if (word := getattr(row, name))))

    def reduce(function, name: str, selected: Sequence[HazardRow]):
        # Reduces the numbers in a column of the selected rows to one; None if there are none.
        known = [value for row in selected if (value := getattr(row, name)) is not None]
        return round(function(known), 1) if known else None

    return {
        "hazards": len(rows),
        "struck": len(activated),
        "outcomes": count("outcome"),
        "check_responses": count("check_response"),
        "motion_hazards": count("motion_hazard"),
        "left_room": len(answerable),
        "right_responses": len(right),
        "median_reaction_ms": reduce(statistics.median, "reaction_ms", right),
        "score": reduce(statistics.fmean, "score", answerable),
        "farthest_mm": reduce(max, "peak_unintended_mm", activated),
        "deepest_mm": reduce(max, "deepest_mm", activated),
    }


def as_csv(columns: Sequence[str], rows: Iterable[Json]) -> str:
    """Return the columns as CSV. An apostrophe precedes text that a spreadsheet would compute."""
    out = io.StringIO()
    writer = csv.DictWriter(out, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for row in rows:
        writer.writerow({name: without_formula(value) for name, value in row.items()})
    return out.getvalue()
