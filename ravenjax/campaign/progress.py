"""How far a campaign is: counted by whatever thread got something done, told to whoever watches.

progress.json in a result folder says the same, for whatever watches it from outside: it is replaced
in one step, at most once a second, and never holds up or ends a campaign. `phase` is that of
`Status`; a start that was killed leaves its last one behind, with the process that wrote it and
when (`pid`, `host`, `updated`).
"""

from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import socket
import threading
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ravenjax.store import files, manifest

FILE = "progress.json"
EVERY_S = 1.0
"""Least time between two versions of the same phase."""


@dataclasses.dataclass(frozen=True)
class Status:
    """How far a campaign is."""

    phase: str  # "compile", "run", "done"; "stopped" where a start ended before its work did
    done: int  # runs finished, those of earlier starts included
    total: int
    compile_s: float  # s, tracing and compiling
    run_s: float  # s, executing so far
    progress: float  # share of this start's work that is done, 0 to 1
    failed: int  # runs whose outcome is not valid, those of earlier starts included
    engine: str  # which engine runs, on what
    earlier: int = 0  # runs that were finished before this start
    parts: int = 0  # parts of this start that are stored
    workers: int = 1  # processes or tasks side by side
    failures: Mapping[str, int] = dataclasses.field(default_factory=dict)  # `failed` by cause
    notes: tuple[str, ...] = ()  # what somebody should know: parts set aside, workers that died

    @property
    def left_s(self) -> float | None:
        """Estimated seconds left."""
        return self.run_s * (1.0 - self.progress) / self.progress if self.progress > 0 else None

    @property
    def runs_per_s(self) -> float | None:
        """Runs of this start per second of execution, ticks of unfinished ones included; None
        where none has begun.
        """
        started = self.run_s > 0.0 and self.progress > 0.0
        return (self.total - self.earlier) * self.progress / self.run_s if started else None


OnProgress = Callable[[Status], None]


class Progress:
    """The counters of one start of a campaign."""

    def __init__(
        self,
        engine: str,
        total: int,
        rows: int,
        ticks: int,
        on_progress: OnProgress | None,
        workers: int = 1,
        notes: tuple[str, ...] = (),
    ) -> None:
        """engine: in words. total: runs of the campaign, of which this start computes `rows`, of
        so many ticks each.
        """
        self.stored = self.failed = 0
        self.compile_s = self.run_s = 0.0
        self._engine, self._total, self._earlier, self._on_progress = (
            engine,
            total,
            total - rows,
            on_progress,
        )
        self._ticks_done, self._ticks_due = 0, max(1, rows * ticks)
        self.workers, self._notes = workers, notes
        self._parts, self._failures = 0, dict[str, int]()
        self._began = 0.0
        self._lock = threading.RLock()

    def began(self, compile_s: float) -> None:
        """The code is compiled, the clock of the runs starts; where several compile, with the
        first.
        """
        if not self._began:
            self.compile_s, self._began = compile_s, time.perf_counter()
        self.tell("run")

    def more_due(self, ticks: int) -> None:
        """There are ticks to compute that no row asked for: of golden runs, of lanes that only
        fill a block.
        """
        with self._lock:
            self._ticks_due += ticks

    def ticks(self, ticks: int) -> None:
        """So many ticks were computed."""
        with self._lock:
            self._ticks_done += ticks
            self.tell("run")

    def rows(self, stored: int, failed: int) -> None:
        """So many rows were stored, of which some have no valid outcome."""
        with self._lock:
            self.stored += stored
            self.failed += failed

    def part(self, rows: int, failures: Mapping[str, int]) -> None:
        """A part of so many rows was stored; failures: those without a valid outcome, by cause."""
        with self._lock:
            self.rows(rows, sum(failures.values()))
            self._parts += 1
            self.lost(failures)

    def known(self, failures: Mapping[str, int]) -> None:
        """Rows that earlier starts stored without a valid outcome, by cause."""
        self.failed += sum(failures.values())
        self.lost(failures)

    def lost(self, failures: Mapping[str, int]) -> None:
        """So many more rows failed, by cause."""
        with self._lock:
            for cause, count in failures.items():
                self._failures[cause] = self._failures.get(cause, 0) + count

    def note(self, sentence: str) -> None:
        """Something that somebody should know."""
        with self._lock:
            self._notes = (*self._notes, sentence)

    def tell(self, phase: str) -> None:
        """Tell how far the campaign is."""
        if self._began:
            self.run_s = time.perf_counter() - self._began
        if self._on_progress is None:
            return
        self._on_progress(
            Status(
                phase=phase,
                done=self._earlier + self.stored,
                total=self._total,
                compile_s=self.compile_s,
                run_s=self.run_s,
                progress=1.0 if phase == "done" else min(1.0, self._ticks_done / self._ticks_due),
                failed=self.failed,
                engine=self._engine,
                earlier=self._earlier,
                parts=self._parts,
                workers=self.workers,
                failures=dict(self._failures),
                notes=self._notes,
            )
        )


class ProgressFile:
    """Keeps progress.json of a folder up to date; call it with each `Status`, which it passes on
    to `then`.
    """

    def __init__(self, folder: Path, then: OnProgress | None = None) -> None:
        self._then = then
        self._path, self._started = folder / FILE, manifest.now()
        self._phase, self._written = "", -EVERY_S

    def __call__(self, status: Status) -> None:
        self._write(status)
        if self._then is not None:
            self._then(status)

    def _write(self, status: Status) -> None:
        now = time.monotonic()
        if status.phase == self._phase and now - self._written < EVERY_S:
            return
        self._phase, self._written = status.phase, now
        with contextlib.suppress(OSError):  # whoever watches waits; the campaign does not
            files.replace(self._path, json.dumps(self.content(status), indent=1) + "\n")

    def content(self, status: Status) -> dict[str, Any]:
        """What the file says."""
        return {
            "phase": status.phase,
            "done": status.done,
            "total": status.total,
            "share_of_this_start": round(status.progress, 6),
            "runs_per_s": status.runs_per_s,
            "eta_s": 0.0 if status.phase == "done" else status.left_s,
            "compile_s": status.compile_s,
            "run_s": status.run_s,
            "parts": status.parts,
            "failed": dict(status.failures),
            "workers": status.workers,
            "engine": status.engine,
            "notes": list(status.notes),
            "started": self._started,
            "updated": manifest.now(),
            "pid": os.getpid(),
            "host": socket.gethostname(),
        }
