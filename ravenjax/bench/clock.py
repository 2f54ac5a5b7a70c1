"""Time that a piece of work takes on a machine that may be doing other things, too."""

from __future__ import annotations

import dataclasses
import resource
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

COMPILED = "/jax/core/compile/backend_compile_duration"
"""JAX's own name for the seconds that XLA spends on a program."""
_STAT = Path("/proc/stat")
_IDLE = (3, 4)  # of the numbers of its first line: idle, and waiting for a disk
_TIMES = 8  # guests' times are part of others


@dataclasses.dataclass(frozen=True)
class WorkTiming:
    """Seconds of one piece of work, done several times."""

    best_s: float  # s, the least disturbed
    median_s: float  # s
    repeats: int


@dataclasses.dataclass(frozen=True)
class Repeats:
    """One quantity, measured several times."""

    values: tuple[float, ...]  # in the order in which they were measured, one at least

    @property
    def smallest(self) -> float:
        """Of times the least disturbed."""
        return min(self.values)

    @property
    def largest(self) -> float:
        """Of rates the least disturbed."""
        return max(self.values)

    @property
    def median(self) -> float:
        """As many are above as below."""
        return statistics.median(self.values)

    @property
    def spread(self) -> float:
        """Largest less smallest, as a share of the median; 0 of a single one."""
        return (self.largest - self.smallest) / self.median if self.median else 0.0


REPEATS = 7
"""Of a piece of work, at most."""


def timed(work: Callable[[], Any], repeats: int, enough_s: float) -> WorkTiming:
    """Do `work` once untimed, then up to `repeats` times, or until `enough_s` are spent; once at
    least.
    """
    work()
    times: list[float] = []
    while not times or (len(times) < repeats and sum(times) < enough_s):
        times.append(seconds(work))
    return WorkTiming(min(times), statistics.median(times), len(times))


def seconds(work: Callable[[], Any]) -> float:
    """Seconds that `work` takes this once."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


@contextmanager
def xla_compiling() -> Iterator[list[float]]:
    """Collects the seconds that XLA spends on each program meanwhile."""
    from jax import monitoring

    spent: list[float] = []

    def listen(event: str, duration_secs: float, **kwargs: Any) -> None:
        if event == COMPILED:
            spent.append(duration_secs)

    monitoring.register_event_duration_secs_listener(listen)
    try:
        yield spent
    finally:
        monitoring.unregister_event_duration_listener(listen)


class Bystanders:
    """Cores that other processes of this machine kept busy since it was made; nan where the
    system does not tell.
    """

    def __init__(self) -> None:
        self._wall, self._busy, self._own = time.perf_counter(), busy_ticks(_STAT), _own_s()

    def cores(self) -> float:
        """Mean number of them; processes of this one count once they have ended."""
        wall, busy = time.perf_counter() - self._wall, busy_ticks(_STAT) - self._busy
        return (
            max(0.0, busy / _TICKS_A_SECOND - (_own_s() - self._own)) / wall
            if wall and busy == busy
            else busy
        )


_TICKS_A_SECOND = 100.0  # USER_HZ, in which Linux writes /proc/stat on every architecture


def busy_ticks(path: Path) -> float:
    """Ticks that all CPUs of the machine have been busy, or taken away from it; nan where the
    system does not tell.
    """
    try:
        numbers = [int(word) for word in path.read_text().splitlines()[0].split()[1 : 1 + _TIMES]]
    except (OSError, ValueError, IndexError):
        return float("nan")
    return (
        float(sum(number for place, number in enumerate(numbers) if place not in _IDLE))
        if numbers
        else float("nan")
    )


def _own_s() -> float:
    """CPU seconds of this process and of those that it started and that have ended."""
    usage = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in usage)
