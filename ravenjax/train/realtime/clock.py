"""Begins a tick each millisecond by the monotonic clock, and measures how late ticks begin."""

from __future__ import annotations

import contextlib
import dataclasses
import gc
import os
import sys
import time
from collections.abc import Callable, Iterator

import numpy as np

PERIOD_NS = 1_000_000
"""The robot's control cycle."""
PHASE_NS = PERIOD_NS // 2
"""When in its millisecond a tick is due: Linux's own timer interrupts, 10-50 us on a virtual
machine, come at whole ones (kernels since 6.5 with 100, 250 or 1000 of them a second)."""
_CPUS = len(os.sched_getaffinity(0)) if sys.platform == "linux" else os.cpu_count() or 1
LEAD_NS = PERIOD_NS if _CPUS >= 4 else 300_000 if _CPUS > 1 else 0
"""Awake so long before a tick is due: what a sleep leaves behind, a late interrupt, a slow clock
and caches that others have filled, is over when the tick begins. With four CPUs one has nothing
else to do and never sleeps; where there is one only, others need it more."""
WARM_UP_NS = 110_000
"""Work that keeps the caches warm begins so long before a tick is due: the time of a tick and a
margin."""
MOST_BEHIND = 100
"""Ticks that are made up for; further behind (a suspended machine), the schedule moves on
instead.
"""
LATE_US = 1000
"""A tick that begins a whole period late has overrun."""
BINS = 20_000
"""Of a histogram, one microsecond each; what is longer is in the last."""


@dataclasses.dataclass
class LoopTiming:
    """Histograms of a loop, in microseconds: what ticks took until frame and force were out, what
    they took with all that follows, how late they began."""

    compute: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(BINS, np.int64))
    whole: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(BINS, np.int64))
    lateness: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(BINS, np.int64))
    late: int = 0  # ticks that began a period late
    skipped: int = 0  # ms by which the schedule was moved on

    @property
    def ticks(self) -> int:
        """How many."""
        return int(self.lateness.sum())

    def percentile(self, what: str, share: float) -> float:
        """The given share's quantile of "compute", "whole" or "lateness", us; NaN before the
        first tick.
        """
        counts = getattr(self, what).cumsum()
        if not counts[-1]:
            return float("nan")
        return float(np.searchsorted(counts, share * counts[-1]))


class Clock:
    """Says when the next tick begins: `wait()`, the tick, `done()`; what can follow, `rest()`."""

    def __init__(self) -> None:
        self.timing = LoopTiming()
        self.compute_us = self.lateness_us = 0.0
        self._began = time.monotonic_ns()
        self._due = self._began // PERIOD_NS * PERIOD_NS + PHASE_NS

    def wait(self, warm_up: Callable[[], None] | None = None) -> None:
        """Sleep until shortly before the next tick is due, then look at the clock until it is.

        warm_up: called as late as possible before the tick, if there is time for it.
        """
        self._due += PERIOD_NS
        due, now = self._due, time.monotonic_ns()
        if now < due - LEAD_NS:
            time.sleep((due - LEAD_NS - now) * 1e-9)
            now = time.monotonic_ns()
        if warm_up is not None and now < due - WARM_UP_NS // 2:
            while now < due - WARM_UP_NS:
                now = time.monotonic_ns()
            warm_up()
            now = time.monotonic_ns()
        while now < due:
            now = time.monotonic_ns()
        self.lateness_us, self._began = float((now - due) // 1000), now

    def done(self) -> None:
        """The tick is computed: what others wait for is out."""
        took = (time.monotonic_ns() - self._began) // 1000
        late = int(self.lateness_us)
        timing = self.timing
        timing.compute[min(took, BINS - 1)] += 1
        timing.lateness[min(late, BINS - 1)] += 1
        if late >= LATE_US:
            timing.late += 1
            behind = (self._began - self._due) // PERIOD_NS
            if behind > MOST_BEHIND:
                timing.skipped += behind
                self._due += behind * PERIOD_NS
        self.compute_us = float(took)

    def rest(self) -> None:
        """What could follow is done too."""
        self.timing.whole[min((time.monotonic_ns() - self._began) // 1000, BINS - 1)] += 1


@contextlib.contextmanager
def realtime(choose: Callable[[set[int]], int] = max) -> Iterator[str]:
    """Give this process one CPU and, where the system allows it, a realtime priority.

    Yields what was granted. choose: which of the CPUs; a robot in a process of its own takes
    another than the session that drives it. The process is as before afterwards. Send processes
    that it has spawned elsewhere: `other_cpus`.
    """
    if sys.platform != "linux":
        yield "as the system schedules"
        return
    cpus, policy, priority = os.sched_getaffinity(0), os.sched_getscheduler(0), os.sched_getparam(0)
    granted = []
    if len(cpus) > 1:
        os.sched_setaffinity(0, {choose(cpus)})
        granted.append(f"CPU {choose(cpus)}")
    if LEAD_NS >= PERIOD_NS:
        # With a realtime priority it would be stopped for 50 ms in every second.
        granted.append("always awake")
    else:
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


def other_cpus() -> set[int]:
    """CPUs that `realtime` leaves to others; empty where there are none to choose from."""
    cpus = os.sched_getaffinity(0) if sys.platform == "linux" else set[int]()
    return cpus - {max(cpus)} if len(cpus) > 1 else set()


@contextlib.contextmanager
def no_collection() -> Iterator[None]:
    """Without the garbage collector, whose pauses are longer than a tick; a tick makes no
    cycles.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
