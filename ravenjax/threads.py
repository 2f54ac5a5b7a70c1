"""Applies a function to many items in parallel threads of this process."""

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from ravenjax import interruption

S = TypeVar("S")
T = TypeVar("T")


def map_in_threads(
    function: Callable[[S], T], items: Iterable[S], most: int | None = None
) -> list[T]:
    """Apply `function` to each item in parallel threads. Return the results in order. most: largest
    number of threads; None: the number of cores of this process. After an error or a signal, no
    further calls begin, and the exception is raised when the running calls have ended.
    """
    items = list(items)
    thread_count = min(len(items), most or len(os.sched_getaffinity(0)))
    if thread_count <= 1:
        return [function(item) for item in items]
    with interruption.delay_signals(), ThreadPoolExecutor(thread_count) as pool:
        try:
            # All calls are submitted before the first result is awaited.
            return [
                interruption.wait_for_result(future)
                for future in [pool.submit(function, item) for item in items]
            ]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
