"""A millisecond after another by the monotonic clock, and how well that was kept."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import gc
import os
import sys
import time
from collections.abc import Iterator

import numpy as np

PERIOD_NS = 1_000_000
"""The robot's control cycle."""
MOST_BEHIND = 100
"""Ticks that are made up for; further behind (a suspended machine), the schedule moves on instead."""
LATE_US = 1000
"""A tick that begins a whole period late has overrun."""
BINS = 20_000
"""Of a histogram, one microsecond each; what is longer is in the last."""


@dataclasses.dataclass
class Timing:
    """Histograms of a loop, in microseconds: what ticks took, and how late they began."""

    compute: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(BINS, np.int64))
    lateness: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(BINS, np.int64))
    late: int = 0  # ticks that began a period late
    skipped: int = 0  # ms by which the schedule was moved on

    @property
    def ticks(self) -> int:
        """How many."""
        return int(self.lateness.sum())

    def percentile(self, what: str, share: float) -> float:
        """The given share's quantile of "compute" or "lateness", us; NaN before the first tick."""
        counts = getattr(self, what).cumsum()
        if not counts[-1]:
            return float("nan")
        return float(np.searchsorted(counts, share * counts[-1]))


class Clock:
    """Says when the next tick begins: `wait()`, the tick, `done()`."""

    def __init__(self, timing: Timing | None = None) -> None:
        self.timing = Timing() if timing is None else timing
        self.compute_us = self.lateness_us = 0.0
        self._due = self._began = time.monotonic_ns()

    def wait(self) -> None:
        """Sleep until the next tick is due."""
        self._due += PERIOD_NS
        now = time.monotonic_ns()
        if now < self._due:
            time.sleep((self._due - now) * 1e-9)
            now = time.monotonic_ns()
        late = (now - self._due) // 1000
        timing = self.timing
        timing.lateness[min(max(late, 0), BINS - 1)] += 1
        if late >= LATE_US:
            timing.late += 1
            behind = (now - self._due) // PERIOD_NS
            if behind > MOST_BEHIND:
                timing.skipped += behind
                self._due += behind * PERIOD_NS
        self.lateness_us, self._began = float(late), now

    def done(self) -> None:
        """The tick is computed."""
        took = (time.monotonic_ns() - self._began) // 1000
        self.timing.compute[min(took, BINS - 1)] += 1
        self.compute_us = float(took)


def prefer_realtime() -> str:
    """Ask the system for punctual wake-ups and, where it lets us, a realtime priority; what was granted, in words."""
    granted = []
    if sys.platform == "linux":
        if ctypes.CDLL(None).prctl(29, 1, 0, 0, 0) == 0:  # PR_SET_TIMERSLACK, ns
            granted.append("timer slack 1 ns")
        try:
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
            granted.append("SCHED_FIFO")
        except OSError:
            granted.append("normal priority")
    return ", ".join(granted) or "as the system schedules"


@contextlib.contextmanager
def no_collection() -> Iterator[None]:
    """Without the garbage collector, whose pauses are longer than a tick; a tick makes no cycles."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
