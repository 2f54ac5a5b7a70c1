"""The recorder: a process of its own that takes what a session writes into its rings and puts it
into files.

Nobody waits for it. If it cannot keep up, rows are overwritten before it reads
them: the event "lost_rows" counts them, and they leave a gap. It ends at the event "end", at
SIGTERM, or when its parent is gone, and always closes the file, unless it is killed: then all but
the last `POLL_S` and a block are there (`store.recover`).
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.store.logs.session import description
from ravenjax.store.logs.session import log as session_log
from ravenjax.train.realtime.ring import Ring, read_json

POLL_S = 0.015
"""s between looks at the rings: what a kill loses at most is this, one block and the scheduler's
delay.
"""
BLOCK = 128
"""Rows of a block at most, so that one that has fallen behind loses little more."""
LINGER_S = 0.5
"""s after "end" in which a last row may still come."""


@dataclass(frozen=True)
class RecorderOptions:
    """What the recorder needs; goes to it by pickling."""

    frames: str  # name of the ring of rows
    events: str  # name of the ring of events
    names: tuple[str, ...]  # of a row's numbers, `frame.FrameLayout.names()`
    folder: Path
    header: Mapping[str, Any]  # session.json without "version", "started", "ended"


def run(options: RecorderOptions, listening: Callable[[], None] = lambda: None) -> None:
    """Record until the session ends. listening: called once session.mcap is there.

    Raises StoreError where the folder cannot be written, ValueError where the ring's rows have
    another length.
    """
    stop = _Stop()
    header = {"started": now(), **options.header, "ended": None}
    description.write(options.folder, header)
    with contextlib.ExitStack() as stack:
        frames, events = Ring.attach(options.frames), Ring.attach(options.events)
        stack.callback(frames.close)
        stack.callback(events.close)
        if frames.row_bytes != 4 * len(options.names):
            raise ValueError(
                f"rows have {frames.row_bytes} bytes, expected {4 * len(options.names)} for their"
                " names"
            )
        log = session_log.SessionWriter(options.folder / session_log.FILE, options.names, header)
        stack.callback(log.close)
        listening()
        summary = _record(frames, events, log, options.names.index("late_ticks"), stop)
    description.update(options.folder, {"ended": now(), "summary": {"recording": summary}})


def now() -> str:
    """UTC, ISO 8601 to the millisecond."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _record(
    frames: Ring, events: Ring, log: session_log.SessionWriter, late_ticks: int, stop: _Stop
) -> dict[str, Any]:
    """Returns what session.json says of the recording; late_ticks: that number's place in a row."""
    row = event = 0
    summary = {"rows": 0, "seconds": 0.0, "lost_rows": 0, "events": 0, "late_ticks": 0}
    while True:
        # Asked before the look, so that what came before it is taken.
        leaving = stop.is_due()
        first_event, rows_of_events = events.read(event)
        first, raw = frames.read(row, BLOCK)
        batch = list(read_json(rows_of_events))
        lost = first - row
        if lost:
            batch.append({"kind": "lost_rows", "tick": row, "rows": lost})
        if lost_events := first_event - event:
            batch.append({"kind": "lost_events", "tick": row, "events": lost_events})
        row, event = first + len(raw), first_event + len(rows_of_events)
        if len(raw) or batch:
            rows = raw.view(np.float32)
            log.add(first, rows, batch)
            summary["rows"] += len(rows)
            summary["lost_rows"] += lost
            summary["events"] += len(batch)
            if len(rows):
                summary["late_ticks"] = int(rows[-1, late_ticks])
        if any(told["kind"] == "end" for told in batch):
            stop.after(LINGER_S)
        behind = frames.written - row
        if leaving and not behind:
            return summary | {"seconds": round(summary["rows"] * 1e-3, 3)}
        if behind < BLOCK:
            time.sleep(POLL_S)


class _Stop:
    """Whether to leave: asked by SIGTERM, left alone by the parent, or some time after the
    session's end.
    """

    def __init__(self) -> None:
        self._at = float("inf")
        signal.signal(signal.SIGTERM, lambda *_: self.after(0.0))
        # Ctrl-C reaches every process; the session ends first.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        self._parent = multiprocessing.parent_process()

    def after(self, seconds: float) -> None:
        self._at = min(self._at, time.monotonic() + seconds)

    def is_due(self) -> bool:
        if self._parent is not None and not self._parent.is_alive():
            self.after(0.0)
        return time.monotonic() >= self._at
