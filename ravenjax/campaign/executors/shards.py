"""One share of a campaign for each job of a batch scheduler: `--shard 2/7`.

Chunks are dealt out in turn, chunk k to shard k mod N, so that a shard has rows of every group and
all end together.
"""

from __future__ import annotations

import re
from typing import NamedTuple

from ravenjax.errors import UserError, shown

CHUNKS = 16
"""Chunks of a shard, at least, where nobody chose their size and the campaign is large enough."""
FEWEST_ROWS = 64
"""Rows of a chunk, at least, where nobody chose their number."""


class Shard(NamedTuple):
    """Share `number` (from 1) of `of`."""

    number: int
    of: int

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"

    @property
    def folder(self) -> str:
        """Name of its result folder."""
        return f"shard-{self.number}-of-{self.of}"

    def chunk(self, runs: int, chunk: int) -> int:
        """Rows of a chunk, `chunk` where that is small enough to share a campaign of so many
        runs out evenly.
        """
        return min(chunk, max(FEWEST_ROWS, -(-runs // (CHUNKS * self.of))))

    def rows(self, runs: int, chunk: int) -> list[range]:
        """Its rows of a campaign of so many runs."""
        starts = range((self.number - 1) * chunk, runs, self.of * chunk)
        return [range(start, min(start + chunk, runs)) for start in starts]


def parse(text: str) -> Shard:
    """A shard as the command line names it; raises UserError."""
    match = re.fullmatch(r"\s*(\d+)\s*/\s*(\d+)\s*", text)
    if match is not None:
        shard = Shard(int(match[1]), int(match[2]))
        if 1 <= shard.number <= shard.of:
            return shard
    raise UserError(
        f"--shard {shown(text)}: expected i/N with 1 <= i <= N, as 2/7 for the second of seven"
    )
