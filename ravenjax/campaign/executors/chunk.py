"""What is the same wherever a chunk is computed: from its outcomes to what is delivered."""

from __future__ import annotations

from typing import TypeVar

from ravenjax.campaign import assembly, outcomes
from ravenjax.campaign.executors.protocol import FinishedChunk, Pack
from ravenjax.campaign.plan import Plan

T = TypeVar("T")


def finished(ready: Plan, part: assembly.PartRows, pack: Pack[T]) -> FinishedChunk[T]:
    """The rows of `part`, which are rows of `ready`, packed."""
    runs = ready.rows.take(slice(part.rows.start, part.rows.stop))
    rows = outcomes.columns(ready.config, runs, *part.tables())
    first = int(runs.numbers("index")[0])
    failures = {cause: count for cause, count in rows["failed"].counts().items() if cause and count}
    return FinishedChunk(range(first, first + len(runs)), pack(rows), failures)
