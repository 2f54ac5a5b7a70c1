"""The recorder: a process of its own that takes what a session writes into its rings and puts it
into files.

Nobody waits for it. Where it could not keep up, rows that were overwritten before it came are
counted, told in the recording (event "lost_rows") and leave a gap. It ends at the event "end", at
SIGTERM, or when its parent is gone, and always closes the file, unless it is killed: then all but
the last `POLL_S` and a block are there (`store.recover`).
"""

from __future__ import annotations

import contextlib
import multiprocessing
import signal
import time
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.store.logs.session import description
from ravenjax.store.logs.session import log as session_log
from ravenjax.train.realtime.clock import BINS
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


def run(options: RecorderOptions) -> None:
    """Record until the session ends. The target of a spawned process; session.mcap is there once it
    listens.

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
        tally = _record(frames, events, log, list(options.names), stop)
    description.update(options.folder, {"ended": now(), "summary": {"recording": tally.summary()}})


def now() -> str:
    """UTC, ISO 8601 to the millisecond."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


def _record(
    frames: Ring, events: Ring, log: session_log.SessionWriter, names: list[str], stop: _Stop
) -> _Tally:
    tally = _Tally(names)
    row = event = 0
    while True:
        leaving = stop.now()  # asked before the look, so that what came before it is taken
        first_event, rows_of_events = events.read(event)
        first, raw = frames.read(row, BLOCK)
        batch = list(read_json(rows_of_events))
        if lost := first - row:
            batch.append({"kind": "lost_rows", "tick": row, "rows": lost})
        if lost_events := first_event - event:
            batch.append({"kind": "lost_events", "tick": row, "events": lost_events})
        row, event = first + len(raw), first_event + len(rows_of_events)
        if len(raw) or batch:
            rows = raw.view(np.float32)
            log.add(first, rows, batch)
            tally.add(rows, lost, len(batch))
        if any(one["kind"] == "end" for one in batch):
            stop.after(LINGER_S)
        behind = frames.written - row
        if leaving and not behind:
            return tally
        if behind < BLOCK:
            time.sleep(POLL_S)


class _Stop:
    """Whether to leave: asked by SIGTERM, left alone by the parent, or some time after the
    session's end.
    """

    def __init__(self) -> None:
        self._at = float("inf")
        signal.signal(signal.SIGTERM, lambda *_: self.after(0.0))
        signal.signal(
            signal.SIGINT, signal.SIG_IGN
        )  # Ctrl-C reaches every process; the session ends first
        self._parent = multiprocessing.parent_process()

    def after(self, seconds: float) -> None:
        self._at = min(self._at, time.monotonic() + seconds)

    def now(self) -> bool:
        if self._parent is not None and not self._parent.is_alive():
            self.after(0.0)
        return time.monotonic() >= self._at


class _Tally:
    """What session.json says of the recording."""

    def __init__(self, names: list[str]) -> None:
        self._places = [names.index(name) for name in ("compute_us", "lateness_us")]
        self._late = names.index("late_ticks")
        self._times = np.zeros((2, BINS), np.int64)
        self._rows = self._lost = self._events = self._late_ticks = 0

    def add(self, rows: np.ndarray, lost: int, events: int) -> None:
        self._rows, self._lost, self._events = (
            self._rows + len(rows),
            self._lost + lost,
            self._events + events,
        )
        if len(rows):
            for counts, place in zip(self._times, self._places, strict=True):
                counts += np.bincount(
                    np.clip(rows[:, place], 0, BINS - 1).astype(np.int64), minlength=BINS
                )
            self._late_ticks = int(rows[-1, self._late])

    def summary(self) -> dict[str, Any]:
        out: dict[str, Any] = {
            "rows": self._rows,
            "seconds": round(self._rows * 1e-3, 3),
            "lost_rows": self._lost,
            "events": self._events,
            "late_ticks": self._late_ticks,
        }
        if self._rows:
            for counts, name in zip(self._times, ("compute_us", "lateness_us"), strict=True):
                sums = counts.cumsum()
                levels = [
                    int(np.searchsorted(sums, share * sums[-1])) for share in (0.5, 0.99, 0.999)
                ]
                out[name] = dict(zip(("p50", "p99", "p99_9"), levels, strict=True))
        return out
