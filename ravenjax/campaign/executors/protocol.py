"""What an executor is: chunks of a plan in, each chunk's finished part out, in whatever order.

A chunk is a range of rows. Wherever it is computed, its rows are the same, and so are the bytes of
its part. Only the coordinator, the process that the user started, touches the result folder: others
hand it the bytes of finished parts. So no worker needs to see the folder, a worker that dies cannot
spoil it, and whatever a disk refuses is met in one place.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

from ravenjax import interruption
from ravenjax.campaign import outcomes
from ravenjax.campaign.memory_windows import PartRows
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress import Progress
from ravenjax.engines.interface import Engine

Pack = Callable[[Mapping[str, Any]], Any]
"""Makes what is kept of a chunk from the columns of its rows. It travels to where the chunk is
computed.
"""

WAITING_CALLS = 4
"""Calls of a BackgroundQueue that wait for a thread, at most."""


@dataclass(frozen=True, eq=False)
class FinishedChunk:
    """A chunk whose rows are all computed."""

    rows: range
    packed: Any  # what `Work.pack` made of its columns
    failures: dict[str, int]  # runs without a valid outcome, by cause


@dataclass(frozen=True, eq=False)
class Work:
    """What there is to compute, and where to put it."""

    plan: Plan
    engine: Engine
    pack: Pack
    # may be called from several threads at once; what it raises ends the work
    deliver: Callable[[FinishedChunk], None]
    progress: Progress


class Executor(Protocol):
    """Computes chunks."""

    @property
    def name(self) -> str:
        """As `--executor` takes it."""
        ...

    @property
    def workers(self) -> int | None:
        """Tasks side by side, as asked for; None: as many as there is room for."""
        ...

    def run(self, work: Work, chunks: Sequence[range]) -> None:
        """Compute and deliver every chunk, each exactly once.

        A chunk that fails does not hold up the others: UserError names it and why once they are
        delivered. What ends the work early (a signal, an error of `deliver`) leaves what is
        delivered as it is.
        """
        ...


def finish_chunk(plan: Plan, part: PartRows, pack: Pack) -> FinishedChunk:
    """The rows of `part`, which are rows of `plan`, packed."""
    runs = plan.rows.take(slice(part.rows.start, part.rows.stop))
    rows = outcomes.columns(plan.config, runs, part.outcomes, part.golden_runs)
    first = int(runs.numbers("index")[0])
    causes = rows["failed"].value_counts().to_dict()
    failures = {cause: count for cause, count in causes.items() if cause}
    return FinishedChunk(range(first, first + len(runs)), pack(rows), failures)


class BackgroundQueue:
    """Runs calls in other threads, with a bound on those that wait. As a context manager it waits
    for the calls that have begun.
    """

    def __init__(self, threads: int) -> None:
        self._pool = ThreadPoolExecutor(threads)
        self._most = threads + WAITING_CALLS
        self._under_way: deque[Future[Any]] = deque()

    def __enter__(self) -> BackgroundQueue:
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=True)

    def call(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Call it soon; waits where too much is under way, and raises what an earlier call
        raised.
        """
        while self._under_way and (len(self._under_way) >= self._most or self._under_way[0].done()):
            interruption.result(self._under_way.popleft())
        self._under_way.append(self._pool.submit(function, *arguments))

    def finish(self) -> None:
        """Wait for every call; raises what one raised."""
        while self._under_way:
            interruption.result(self._under_way.popleft())
