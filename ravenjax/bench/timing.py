"""Time that a piece of work takes. Of several repeats the best is the least disturbed one."""

from __future__ import annotations

import time
from collections.abc import Callable


def measure_once(work: Callable[[], object]) -> float:
    """Seconds that `work` takes this once."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def repeat(work: Callable[[], object], seconds: float, most: int = 9) -> list[float]:
    """Seconds of `work`, done as often as it fits into `seconds`; once at least, `most` times at
    most.
    """
    times: list[float] = []
    while not times or (len(times) < most and sum(times) + times[-1] <= seconds):
        times.append(measure_once(work))
    return times
