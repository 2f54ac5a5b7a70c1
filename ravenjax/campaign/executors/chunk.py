"""What is the same wherever a chunk is computed: from its outcomes to what is delivered."""

from __future__ import annotations

from typing import TypeVar

import pandas as pd

from ravenjax.campaign import assembly, outcomes
from ravenjax.campaign.executors.protocol import FinishedChunk, Pack
from ravenjax.campaign.plan import Plan

T = TypeVar("T")


def finished(ready: Plan, part: assembly.PartRows, pack: Pack[T]) -> FinishedChunk[T]:
    """The rows of `part`, which are rows of `ready`, packed."""
    runs = ready.table.iloc[part.rows.start : part.rows.stop]
    rows = outcomes.columns(ready.config, runs, *part.tables())
    first = int(runs["index"].iloc[0])
    counted = pd.Series(rows["failed"]).value_counts()
    failures = {str(cause): int(count) for cause, count in counted.items() if cause and count}
    return FinishedChunk(range(first, first + len(runs)), pack(rows), failures)
