"""Starts a tick each millisecond of the monotonic clock, and measures how late ticks start."""

import contextlib
import gc
import os
import time
from collections.abc import Callable, Iterator

import numpy as np

PERIOD_NS = 1_000_000  # The period of the robot's control cycle
PHASE_NS = PERIOD_NS // 2
"""Time within a millisecond at which a tick starts, away from Linux's timer interrupts."""
_CPUS = len(os.sched_getaffinity(0))
LEAD_NS = PERIOD_NS if _CPUS >= 4 else 300_000 if _CPUS > 1 else 0
"""How long before a tick the process wakes up, because a CPU is slow just after a sleep.

With four CPUs or more, the loop never sleeps. With one CPU, the other processes need it.
"""
WARM_UP_NS = 110_000
"""How long before a tick the cache-warming work begins: the time of that work and a margin."""
MAX_LATE_TICKS = 100
"""The largest number of late ticks to catch up. After a longer delay the schedule moves on."""
LATE_US = 1000  # A tick that begins at least this late counts as a late tick
BINS = 20_000
"""Bins of a histogram, one microsecond each. The last bin also counts everything longer."""


class LoopTiming:
    """Histograms of a loop, in microseconds. compute: time from a tick's start until frame and
    force are sent. whole: time until all work of the tick is done. lateness: delay of the tick's
    start.
    """

    late = 0  # ticks that began a period late
    skipped = 0  # ms by which the schedule moved on

    def __init__(self):
        self.compute, self.whole, self.lateness = np.zeros((3, BINS), np.int64)

    @property
    def ticks(self) -> int:
        return int(self.lateness.sum())

    def percentile(self, duration: str, share: float) -> float:
        """Return the quantile of a duration, us: of "compute", "whole" or "lateness"; NaN without a
        tick. share: 0 to 1.
        """
        counts = getattr(self, duration).cumsum()
        if not counts[-1]:
            return float("nan")
        # The index of a bin is its duration in us.
        return float(np.searchsorted(counts, share * counts[-1]))

    def facts(self) -> dict[str, float]:
        """Return all numbers by name. Percentiles are in us."""
        facts: dict[str, float] = {"ticks": self.ticks, "late_ticks": self.late}
        facts["skipped_ms"] = self.skipped
        for duration in ("compute", "whole", "lateness"):
            for name, share in (("p50", 0.5), ("p99", 0.99), ("p99_9", 0.999)):
                facts[f"{duration}_{name}_us"] = self.percentile(duration, share)
        return facts


class Clock:
    """Paces a loop. Call `wait()`, compute the tick, `done()`, do the remaining work, `rest()`."""

    compute_us = lateness_us = 0.0

    def __init__(self):
        self.timing = LoopTiming()
        self._began = time.monotonic_ns()
        self._due = self._began // PERIOD_NS * PERIOD_NS + PHASE_NS

    def wait(self, warm_up: Callable[[], None] | None = None) -> None:
        """Wait until the next tick is due, and record how late it begins. The process sleeps until
        `LEAD_NS` before, then reads the clock all the time. warm_up: fills the CPU's caches; called
        as late as possible before the tick, and left out if it is late.
        """
        self._due += PERIOD_NS
        due, now = self._due, time.monotonic_ns()
        if now < due - LEAD_NS:
            time.sleep((due - LEAD_NS - now) * 1e-9)
            now = time.monotonic_ns()
        # With less than half of the warm-up's time left, the tick would be late.
        if warm_up is not None and now < due - WARM_UP_NS // 2:
            while now < due - WARM_UP_NS:
                now = time.monotonic_ns()
            warm_up()
            now = time.monotonic_ns()
        while now < due:
            now = time.monotonic_ns()
        self.lateness_us, self._began = float((now - due) // 1000), now

    def done(self) -> None:
        """Record that the tick is computed and its results are sent."""
        compute_us = (time.monotonic_ns() - self._began) // 1000
        lateness_us = int(self.lateness_us)
        timing = self.timing
        timing.compute[min(compute_us, BINS - 1)] += 1
        timing.lateness[min(lateness_us, BINS - 1)] += 1
        if lateness_us >= LATE_US:
            timing.late += 1
            # After a long delay, the schedule moves on instead of catching up.
            late_ticks = (self._began - self._due) // PERIOD_NS
            if late_ticks > MAX_LATE_TICKS:
                timing.skipped += late_ticks
                self._due += late_ticks * PERIOD_NS
        self.compute_us = float(compute_us)

    def rest(self) -> None:
        """Record that all work of the tick is done."""
        self.timing.whole[min((time.monotonic_ns() - self._began) // 1000, BINS - 1)] += 1


@contextlib.contextmanager
def use_realtime_priority(choose_cpu: Callable[[set[int]], int] = max) -> Iterator[str]:
    """Give this process one CPU and, where the system allows it, a realtime priority. Yields a
    description of what was granted, and undoes the changes at the end. choose_cpu: selects a CPU.
    `ravenjax robot` selects another CPU than the session that drives the robot.
    """
    cpus, policy, priority = os.sched_getaffinity(0), os.sched_getscheduler(0), os.sched_getparam(0)
    granted = []
    if len(cpus) > 1:
        os.sched_setaffinity(0, {choose_cpu(cpus)})
        granted.append(f"CPU {choose_cpu(cpus)}")
    if LEAD_NS >= PERIOD_NS:
        # Linux stops a realtime process that never sleeps for 50 ms of every second.
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


@contextlib.contextmanager
def no_collection() -> Iterator[None]:
    """Disable the garbage collector, whose pauses are longer than a tick."""
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
        gc.unfreeze()
