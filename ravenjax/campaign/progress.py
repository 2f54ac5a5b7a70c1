"""Reports the progress of a campaign, and writes progress.json in its result folder.

The file is replaced atomically, at most once a second. An error while writing it never delays or
ends a campaign. If the process is killed, its last progress.json remains. The file names the
process (`pid`, `host`) and the time (`updated`).
"""

import contextlib
import dataclasses
import json
import os
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from pathlib import Path

from ravenjax.errors import StoreError
from ravenjax.store import files, manifest

FILE = "progress.json"
WRITE_PERIOD_S = 1.0
"""Shortest time between two versions of the file in the same phase, s."""


@dataclasses.dataclass
class Status:
    """The progress of a campaign. A start is one call of the command, which may be interrupted."""

    phase: str  # "compile", "run", "done", or "stopped" if the start was interrupted
    done: int  # number of finished runs, including those of earlier starts
    total: int
    engine: str  # engine and device, as text
    compile_s: float = 0.0  # time of compilation, s
    run_s: float = 0.0  # time of computation so far, s
    progress: float = 0.0  # finished share of this start's work, 0 to 1
    earlier: int = 0  # number of runs that were finished before this start
    parts: int = 0  # number of files that this start has stored
    workers: int = 1  # parallel processes or tasks
    # Number of runs without a valid outcome by cause, including those of earlier starts.
    failures: Mapping[str, int] = dataclasses.field(default_factory=dict)
    notes: tuple[str, ...] = ()  # messages for the user, such as damaged files and dead workers

    @property
    def computed(self) -> int:
        """Number of runs that this start has finished."""
        return self.done - self.earlier

    @property
    def left_s(self) -> float | None:
        """Estimated remaining time, s; None if unknown."""
        return self.run_s * (1.0 - self.progress) / self.progress if self.progress > 0 else None

    @property
    def runs_per_s(self) -> float | None:
        """Runs per second of this start, including parts of unfinished runs; None: unknown."""
        started = self.run_s > 0.0 and self.progress > 0.0
        return (self.total - self.earlier) * self.progress / self.run_s if started else None


OnProgress = Callable[[Status], None]


class Progress:
    """The counters of one start of a campaign. All threads may use them."""

    def __init__(
        self,
        engine: str,
        total: int,
        rows: int,
        ticks: int,
        on_progress: OnProgress | None = None,
        notes: tuple[str, ...] = (),
    ):
        """engine: engine and device, as text. total: number of runs of the campaign. rows: number
        of runs that this start computes, each with `ticks` ticks. on_progress: function that is
        called with each new status.
        """
        earlier = total - rows
        self.status = Status("compile", earlier, total, engine, earlier=earlier, notes=notes)
        self._on_progress = on_progress
        self._ticks_done, self._ticks_due = 0, max(1, rows * ticks)
        self._began = 0.0
        self._lock = threading.RLock()

    def began(self, compile_s: float) -> None:
        """Record the end of the compilation. Only the first call has an effect."""
        if not self._began:
            self.status.compile_s, self._began = compile_s, time.perf_counter()
        self.tell("run")

    def more_due(self, ticks: int) -> None:
        """Add ticks to compute that belong to no row: golden runs, and lanes that fill a block."""
        with self._lock:
            self._ticks_due += ticks

    def ticks(self, ticks: int) -> None:
        """Count computed ticks."""
        with self._lock:
            self._ticks_done += ticks
            self.tell("run")

    def count_part(self, rows: int, failures: Mapping[str, int]) -> None:
        """Count a stored file. failures: number of its runs without a valid outcome, by cause."""
        with self._lock:
            self.status.done += rows
            self.status.parts += 1
            self.count_failures(failures)

    def count_failures(self, failures: Mapping[str, int]) -> None:
        """Count runs without a valid outcome, by cause."""
        with self._lock:
            self.status.failures = Counter(self.status.failures) + Counter(failures)

    def note(self, sentence: str) -> None:
        """Add a message for the user."""
        with self._lock:
            self.status.notes = (*self.status.notes, sentence)

    def tell(self, phase: str) -> None:
        """Update the status, and pass a copy to `on_progress`. phase: see `Status.phase`."""
        status = self.status
        if self._began:
            status.run_s = time.perf_counter() - self._began
        status.phase = phase
        status.progress = min(1.0, self._ticks_done / self._ticks_due) if phase != "done" else 1.0
        if self._on_progress is not None:
            self._on_progress(dataclasses.replace(status))


class ProgressFile:
    """Writes a `Status` to progress.json of a folder, and then calls `on_progress` with it."""

    def __init__(self, folder: Path, on_progress: OnProgress | None = None):
        self._on_progress = on_progress
        self._path, self._started = folder / FILE, manifest.utc_now()
        self._phase, self._written_s = "", -WRITE_PERIOD_S

    def __call__(self, status: Status) -> None:
        """Write the status, at most once in WRITE_PERIOD_S of the same phase."""
        now_s = time.monotonic()
        if status.phase != self._phase or now_s - self._written_s >= WRITE_PERIOD_S:
            self._phase, self._written_s = status.phase, now_s
            names = "phase done total runs_per_s compile_s run_s parts workers engine notes"
            content = {name: getattr(status, name) for name in names.split()} | {
                "share_of_this_start": round(status.progress, 6),
                "eta_s": 0.0 if status.phase == "done" else status.left_s,
                "failed": status.failures,
                "started": self._started,
                "updated": manifest.utc_now(),
                "pid": os.getpid(),
                "host": socket.gethostname(),
            }
            # A full disk must not end the campaign, and a slow disk must not delay it.
            with contextlib.suppress(StoreError):
                files.write_text(self._path, json.dumps(content, indent=1) + "\n", waits=False)
        if self._on_progress is not None:
            self._on_progress(status)
