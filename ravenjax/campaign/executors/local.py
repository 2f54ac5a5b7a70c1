"""Executor `local`: this process. Threads inside the engine compute, others pack and deliver behind
them.

Blocks are cut from whatever rows are missing, as large as the engine likes them, across the borders
of chunks. What is under way between plan and disk is bounded: memory grows with the number of runs
by the plan alone.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Sequence
from typing import Any

from ravenjax import interruption
from ravenjax.campaign import assembly
from ravenjax.campaign.computation import Computation
from ravenjax.campaign.executors.background import BackgroundQueue
from ravenjax.campaign.executors.chunk import finished
from ravenjax.campaign.executors.protocol import Work

WRITERS = 12
"""Chunks that are packed and delivered side by side, at most."""


class Local:
    """See `protocol.Executor`."""

    name, workers = "local", 1

    def run(self, work: Work[Any], chunks: Sequence[range]) -> None:
        """See `protocol.Executor`."""
        computation = Computation(work.ready, work.engine, work.progress)
        computation.compile()
        writers = min(WRITERS, len(os.sched_getaffinity(0)))
        with (
            interruption.held_back(),
            BackgroundQueue(writers) as queue,
            contextlib.closing(computation.blocks(chunks)) as blocks,
        ):
            for part in assembly.parts(chunks, blocks):
                queue.call(lambda part: work.deliver(finished(work.ready, part, work.pack)), part)
            queue.finish()
