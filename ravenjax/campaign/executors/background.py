"""Bounded background queue that re-raises what a worker raised: a few threads, few calls
waiting.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from ravenjax import interruption

WAITING = 4
"""Calls that wait for a thread, at most."""


class BackgroundQueue:
    """Calls made in other threads; a context manager, which waits for those that are under way."""

    def __init__(self, threads: int) -> None:
        self._pool = ThreadPoolExecutor(threads)
        self._most = threads + WAITING
        self._under_way: deque[Future[Any]] = deque()

    def __enter__(self) -> BackgroundQueue:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=True)

    def call(self, function: Callable[..., Any], *given: Any) -> None:
        """Call it soon; waits where too much is under way, and raises what an earlier call
        raised.
        """
        while self._under_way and (len(self._under_way) >= self._most or self._under_way[0].done()):
            interruption.result(self._under_way.popleft())
        self._under_way.append(self._pool.submit(function, *given))

    def finish(self) -> None:
        """Wait for every call; raises what one raised."""
        while self._under_way:
            interruption.result(self._under_way.popleft())
