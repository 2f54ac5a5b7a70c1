"""The same work on many things, side by side in threads of this process."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from ravenjax import interruption

S = TypeVar("S")
T = TypeVar("T")


def mapped(function: Callable[[S], T], given: Iterable[S], most: int | None = None) -> list[T]:
    """`function` of each, in order. most: threads, the cores of this process where None. The first
    error, or a signal, is raised when what has begun has ended; what has not is left."""
    things = list(given)
    number = min(len(things), most or len(os.sched_getaffinity(0)))
    if number <= 1:
        return [function(one) for one in things]
    with interruption.held_back(), ThreadPoolExecutor(number) as pool:
        try:
            return [
                interruption.result(future)
                for future in [pool.submit(function, one) for one in things]
            ]
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
