"""How far a campaign is: counted by whatever thread got something done, told to whoever watches."""

from __future__ import annotations

import dataclasses
import threading
import time
from collections.abc import Callable


@dataclasses.dataclass(frozen=True)
class Status:
    """How far a campaign is."""

    phase: str  # "compile", "run" or "done"
    done: int  # runs finished, those of earlier starts included
    total: int
    compile_s: float  # s, tracing and compiling
    run_s: float  # s, executing so far
    progress: float  # share of this start's work that is done, 0 to 1
    failed: int  # runs of this start whose outcome is not valid
    engine: str  # which engine runs, on what

    @property
    def left_s(self) -> float | None:
        """Estimated seconds left."""
        return self.run_s * (1.0 - self.progress) / self.progress if self.progress > 0 else None


OnProgress = Callable[[Status], None]


class Progress:
    """The counters of one start of a campaign."""

    def __init__(self, engine: str, total: int, rows: int, ticks: int, on_progress: OnProgress | None) -> None:
        """engine: in words. total: runs of the campaign, of which this start computes `rows`, of so many ticks each."""
        self.stored = self.failed = 0
        self.compile_s = self.run_s = 0.0
        self._engine, self._total, self._earlier, self._on_progress = engine, total, total - rows, on_progress
        self._ticks_done, self._ticks_due = 0, max(1, rows * ticks)
        self._began = 0.0
        self._lock = threading.Lock()

    def began(self, compile_s: float) -> None:
        """The code is compiled, the clock of the runs starts."""
        self.compile_s, self._began = compile_s, time.perf_counter()
        self.tell("run")

    def more_due(self, ticks: int) -> None:
        """There are ticks to compute that no row asked for: of twins, of lanes that only fill a block."""
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

    def tell(self, phase: str) -> None:
        """Tell how far the campaign is."""
        if self._began:
            self.run_s = time.perf_counter() - self._began
        if self._on_progress is not None:
            share = 1.0 if phase == "done" else min(1.0, self._ticks_done / self._ticks_due)
            done = self._earlier + self.stored
            times = self.compile_s, self.run_s
            self._on_progress(Status(phase, done, self._total, *times, share, self.failed, self._engine))
