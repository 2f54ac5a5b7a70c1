"""Defines executors: objects that compute the chunks of a campaign and deliver the results. A chunk
is a range of rows of the result table, and its *part* is the file with their results. The executor
`local` computes in this process, on all cores or all GPUs. Parts may be delivered in any order. The
bytes of a part do not depend on where it was computed.

Only the coordinator, the process that the user started, writes to the result folder. Workers send
it the bytes of finished parts. Therefore no worker needs access to the folder, a worker that dies
cannot damage the folder, and all disk errors occur in one process.
"""

import contextlib
import os
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any, NamedTuple, Protocol

from ravenjax import interruption
from ravenjax.campaign import memory_windows, outcomes
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.memory_windows import PartRows
from ravenjax.campaign.plan import Plan
from ravenjax.campaign.progress import Progress
from ravenjax.engines.interface import Engine

Pack = Callable[[Mapping[str, Any]], Any]
"""Converts the columns of a chunk to what is stored, in the process that computes the chunk."""

WRITERS = 12
"""Largest number of chunks that executor `local` packs and delivers in parallel."""
WAITING_CALLS = 4
"""Largest number of calls that wait for a thread in a BackgroundQueue."""


class FinishedChunk(NamedTuple):
    """A chunk whose rows are all computed."""

    rows: range
    packed: Any  # result of `Work.pack` for the chunk's columns
    failures: dict[str, int]  # number of runs without a valid outcome, by cause


class Work(NamedTuple):
    """The rows to compute, and where to deliver them."""

    plan: Plan
    engine: Engine
    pack: Pack
    # Several threads may call this function at once. An exception ends the work.
    deliver: Callable[[FinishedChunk], None]
    progress: Progress


class Executor(Protocol):
    """Computes the chunks of a campaign."""

    @property
    def workers(self) -> int | None:
        """Requested number of parallel tasks; None: as many as the machines can run."""
        ...

    def run(self, work: Work, chunks: Sequence[range]) -> None:
        """Compute and deliver every chunk exactly once. If a chunk fails, the others are still
        delivered. Then UserError names the failed chunk and the reason. If a signal or an error of
        `deliver` ends the work early, delivered chunks stay.
        """
        ...


def finish_chunk(plan: Plan, part: PartRows, pack: Pack) -> FinishedChunk:
    """Compute the result columns of a part of `plan`, pack them, and count failed runs by cause."""
    runs = plan.rows.iloc[part.rows.start : part.rows.stop]
    rows = outcomes.result_columns(plan.config, runs, part.outcomes, part.golden_runs)
    # `part.rows` count within `plan`, which may have only some rows of the campaign.
    first_index = int(runs["index"].to_numpy()[0])
    causes = rows["failed"].value_counts().to_dict()
    failures = {cause: count for cause, count in causes.items() if cause}
    return FinishedChunk(range(first_index, first_index + len(runs)), pack(rows), failures)


class BackgroundQueue:
    """Runs function calls in other threads, with a limited number of waiting calls. At the end of
    its `with` block it waits for running calls.
    """

    def __init__(self, threads: int):
        self._pool = ThreadPoolExecutor(threads)
        self._max_calls = threads + WAITING_CALLS
        self._pending: deque[Future[Any]] = deque()

    def __enter__(self) -> "BackgroundQueue":
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown(wait=True)

    def call(self, function: Callable[..., Any], *arguments: Any) -> None:
        """Call `function` in another thread. Wait while too many calls are waiting. Raise the
        exception of an earlier call that failed.
        """
        # The results of finished calls are taken, too, because this raises their exceptions.
        while self._pending and (len(self._pending) >= self._max_calls or self._pending[0].done()):
            interruption.wait_for_result(self._pending.popleft())
        self._pending.append(self._pool.submit(function, *arguments))

    def finish(self) -> None:
        """Wait for all calls. Raise the exception of a call that failed."""
        while self._pending:
            interruption.wait_for_result(self._pending.popleft())


class Local:
    """Computes chunks in this process; see `Executor`."""

    workers = 1

    def run(self, work: Work, chunks: Sequence[range]) -> None:
        """Compute and deliver every chunk, as `Executor.run` describes."""
        computation = Computation(work.plan, work.engine, work.progress)
        writers = min(WRITERS, len(os.sched_getaffinity(0)))
        with (
            interruption.delay_signals(),
            BackgroundQueue(writers) as queue,
            contextlib.closing(computation.blocks(chunks)) as blocks,
        ):
            for part in memory_windows.assemble_parts(chunks, blocks):
                queue.call(
                    lambda part: work.deliver(finish_chunk(work.plan, part, work.pack)), part
                )
            queue.finish()
