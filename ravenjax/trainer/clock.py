"""A millisecond after another by the monotonic clock, and how well that was kept."""

from __future__ import annotations

import contextlib
import ctypes
import dataclasses
import gc
import os
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np

PERIOD_NS = 1_000_000
"""The robot's control cycle."""
MOST_BEHIND = 100
"""Ticks that are made up for; further behind (a suspended machine), the schedule moves on instead."""
LATE_US = 1000
"""A tick that begins a whole period late has overrun."""
_SET_TIMER_SLACK = 29  # linux/prctl.h, PR_SET_TIMERSLACK, ns
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


@contextlib.contextmanager
def realtime(choose: Callable[[set[int]], int] = max) -> Iterator[str]:
    """Punctual wake-ups, one CPU and, where the system lets us, a realtime priority; says what was granted.

    choose: which of the CPUs; a robot in a process of its own takes another than the session that drives it.
    The process is as before afterwards. Processes that it has spawned should be sent elsewhere: `other_cpus`.
    """
    if sys.platform != "linux":
        yield "as the system schedules"
        return
    prctl = ctypes.CDLL(None).prctl
    cpus, policy, priority = os.sched_getaffinity(0), os.sched_getscheduler(0), os.sched_getparam(0)
    granted = ["timer slack 1 ns"] if prctl(_SET_TIMER_SLACK, 1, 0, 0, 0) == 0 else []
    if len(cpus) > 1:
        os.sched_setaffinity(0, {choose(cpus)})
        granted.append(f"CPU {choose(cpus)}")
    try:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(10))
        granted.append("SCHED_FIFO")
    except OSError:
        granted.append("normal priority")
    try:
        yield ", ".join(granted)
    finally:
        os.sched_setscheduler(0, policy, priority)
        os.sched_setaffinity(0, cpus)
        prctl(_SET_TIMER_SLACK, 0, 0, 0, 0)  # 0: the system's own


def other_cpus() -> set[int]:
    """CPUs that `realtime` leaves to others; empty where there are none to choose from."""
    cpus = os.sched_getaffinity(0) if sys.platform == "linux" else set[int]()
    return cpus - {max(cpus)} if len(cpus) > 1 else set()


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
