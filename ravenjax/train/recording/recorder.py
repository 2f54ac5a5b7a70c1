"""Runs the recorder: a process that reads frames and events from the rings of a session, and writes
them into the session's folder.

No process waits for the recorder. It counts the rows that the writer of the ring overwrote before
it could read them. It ends at the event "end", at SIGTERM, or when its parent has ended, and then
closes the file. If it is killed, the last `POLL_S` seconds and up to `BLOCK_ROWS` rows are lost.
"""

import contextlib
import math
import signal
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from ravenjax.store.logs.session import description
from ravenjax.store.logs.session import log as session_log
from ravenjax.store.ring import Ring, parent_has_ended, read_json
from ravenjax.train.protocol import Event, Json

POLL_S = 0.015  # s between readings of the rings. A kill loses at most this time and one block.
BLOCK_ROWS = 128  # The largest number of rows of a block. A kill loses at most one block.
WAITING_MS = 1000  # ms between two rows before the first pedal-down
LINGER_S = 0.5  # s after "end" in which a last row may still arrive


class RowWriter:
    """Writes rows and events to session.mcap. Before the first pedal-down it writes one row a
    second, so that a waiting session needs little disk space.
    """

    def __init__(self, folder: Path, names: Sequence[str], header: Json):
        """Raises StoreError if the file cannot be created."""
        self.summary: Json = {}  # added to session.json at the end
        self.log = session_log.SessionWriter(folder / session_log.FILE, names, header)
        self._columns = [names.index("left_ms"), names.index("pedal")]
        self._duration_ms = 1e3 * header.get("scenario", {}).get("duration_s", math.inf)

    def add(self, first: int, rows: np.ndarray, events: Sequence[Event]) -> int:
        """Write rows that are numbered from `first`, and events. Return the number of rows written.
        Of the rows before the first pedal-down, only each `WAITING_MS`th is written.
        """
        left_ms, pedal = rows[:, self._columns].T
        indices = np.arange(len(rows))
        # The time left is the whole duration until the first pedal-down.
        has_begun = (left_ms < self._duration_ms) | (pedal > 0)
        written = indices[has_begun | ((first + indices) % WAITING_MS == 0)]
        # The log takes runs of successive rows. The last run, which may be empty, takes the events.
        *runs, last_run = np.split(written, np.flatnonzero(np.diff(written) > 1) + 1)
        for run in runs:
            self.log.add(first + int(run[0]), rows[run])
        last_start = int(last_run[0]) if len(last_run) else len(rows)
        self.log.add(first + last_start, rows[last_run], events)
        return len(written)


@contextlib.contextmanager
def open_recording(folder: Path, names: Sequence[str], header: Json) -> Iterator[RowWriter]:
    """Yield a recording's writer; write session.json before and after. names, header: as in
    `record_session`, the names of a row's numbers and the content of session.json.
    """
    header = {"started": utc_now(), **header, "ended": None}
    description.write_session(folder, header)
    writer = RowWriter(folder, names, header)
    with contextlib.closing(writer.log):
        yield writer
    description.update_session(folder, {"ended": utc_now(), "summary": writer.summary})


def record_session(
    frames_ring: str,
    events_ring: str,
    names: Sequence[str],
    folder: Path,
    header: Json,
    listening: Callable[[], None],
) -> None:
    """Record until the session ends. frames_ring, events_ring: names of the rings. names:
    `FrameLayout.names`. header: content of session.json without "version", "started" and "ended".
    listening: called once session.mcap exists. Raises StoreError if the folder cannot be written.
    """
    stopping = threading.Event()
    signal.signal(signal.SIGTERM, lambda *_: stopping.set())
    # Ctrl-C reaches every process, but the session must end first.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # Numbers of the next row and the next event.
    row = event = 0
    end_s, late_ticks = math.inf, names.index("late_ticks")
    counts = dict.fromkeys(("rows", "lost_rows", "events", "late_ticks"), 0)
    with (
        open_recording(folder, names, header) as writer,
        contextlib.closing(Ring.attach(frames_ring)) as frames,
        contextlib.closing(Ring.attach(events_ring)) as events,
    ):
        listening()
        while True:
            # Checked before the rings are read, so that everything before the check is recorded.
            is_last = stopping.is_set() or parent_has_ended() or time.monotonic() >= end_s
            first_event, event_rows = events.read(event)
            first, raw = frames.read(row, BLOCK_ROWS)
            batch = list(read_json(event_rows))
            # An event in the recording reports rows and events that the ring has overwritten.
            lost_rows, lost_events = first - row, first_event - event
            if lost_rows:
                batch.append({"kind": "lost_rows", "tick": row, "rows": lost_rows})
            if lost_events:
                batch.append({"kind": "lost_events", "tick": row, "events": lost_events})
            counts["lost_rows"] += lost_rows
            counts["events"] += len(batch)
            row, event = first + len(raw), first_event + len(event_rows)
            rows = raw.view(np.float32)
            if len(rows) or batch:
                counts["rows"] += writer.add(first, rows, batch)
            if len(rows):
                counts["late_ticks"] = int(rows[-1, late_ticks])
            if any(each["kind"] == "end" for each in batch):
                end_s = min(end_s, time.monotonic() + LINGER_S)
            unread = frames.written - row
            if is_last and not unread:
                break
            if unread < BLOCK_ROWS:
                time.sleep(POLL_S)
        # A row lasts a millisecond.
        writer.summary["recording"] = counts | {"seconds": round(counts["rows"] * 1e-3, 3)}


def utc_now() -> str:
    """Return the present time, UTC, ISO 8601 to the millisecond."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")
