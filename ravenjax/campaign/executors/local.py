"""Executor `local`: computes chunks in this process, whose engine uses every core or every GPU."""

import contextlib
import os
from collections.abc import Sequence

from ravenjax import interruption
from ravenjax.campaign import memory_windows
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.executors.protocol import BackgroundQueue, Work, finish_chunk

WRITERS = 12
"""Largest number of chunks that are packed and delivered in parallel."""


class Local:
    """Computes chunks in this process; see `protocol.Executor`."""

    name, workers = "local", 1

    def run(self, work: Work, chunks: Sequence[range]) -> None:
        """See `protocol.Executor`."""
        computation = Computation(work.plan, work.engine, work.progress)
        computation.compile()
        writers = min(WRITERS, len(os.sched_getaffinity(0)))
        with (
            interruption.held_back(),
            BackgroundQueue(writers) as queue,
            contextlib.closing(computation.blocks(chunks)) as blocks,
        ):
            for part in memory_windows.assemble_parts(chunks, blocks):
                queue.call(
                    lambda part: work.deliver(finish_chunk(work.plan, part, work.pack)), part
                )
            queue.finish()
