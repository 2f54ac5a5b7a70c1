"""Time that a piece of work takes on a machine that may be doing other things, too."""

from __future__ import annotations

import dataclasses
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from jax import monitoring

COMPILED = "/jax/core/compile/backend_compile_duration"
"""JAX's own name for the seconds that XLA spends on a program."""


@dataclasses.dataclass(frozen=True)
class WorkTiming:
    """Seconds of one piece of work, done several times."""

    best_s: float  # s, the least disturbed
    median_s: float  # s
    repeats: int


def timed(work: Callable[[], Any], repeats: int, enough_s: float) -> WorkTiming:
    """Do `work` once untimed, then up to `repeats` times, or until `enough_s` are spent; once at least."""
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
    spent: list[float] = []

    def listen(event: str, duration_secs: float, **kwargs: Any) -> None:
        if event == COMPILED:
            spent.append(duration_secs)

    monitoring.register_event_duration_secs_listener(listen)
    try:
        yield spent
    finally:
        monitoring.unregister_event_duration_listener(listen)
