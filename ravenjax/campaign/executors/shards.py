"""Divides a campaign into shards, one for each job of a batch scheduler: `--shard 2/7`.

A campaign consists of chunks, which are ranges of runs. Chunk k belongs to shard k mod N. So each
shard has runs of every group, and all shards need about the same time.
"""

import re
from typing import NamedTuple

from ravenjax.errors import UserError, format_value

CHUNKS = 16
"""Smallest number of chunks in a shard, if there are enough runs and the user chose no size."""
FEWEST_ROWS = 64
"""Smallest number of rows of a chunk, if the user chose no chunk size."""


class Shard(NamedTuple):
    """Number of a shard (from 1) and number of shards."""

    number: int
    of: int

    def __str__(self) -> str:
        return f"{self.number}/{self.of}"

    @property
    def folder(self) -> str:
        """Name of the shard's result folder."""
        return f"shard-{self.number}-of-{self.of}"

    def chunk(self, runs: int, chunk: int) -> int:
        """Return the rows per chunk: `chunk`, or fewer if needed to divide the campaign evenly."""
        return min(chunk, max(FEWEST_ROWS, -(-runs // (CHUNKS * self.of))))

    def rows(self, runs: int, chunk: int) -> list[range]:
        """Return the rows of this shard in a campaign of `runs` runs."""
        starts = range((self.number - 1) * chunk, runs, self.of * chunk)
        return [range(start, min(start + chunk, runs)) for start in starts]


def parse_shard(text: str) -> Shard:
    """Parse a shard of the command line, such as "2/7". Raise UserError for other forms."""
    match = re.fullmatch(r"\s*(\d+)\s*/\s*(\d+)\s*", text)
    if match is not None:
        shard = Shard(int(match[1]), int(match[2]))
        if 1 <= shard.number <= shard.of:
            return shard
    raise UserError(
        f"--shard {format_value(text)}: expected i/N with 1 <= i <= N, such as 2/7 for the 2nd of"
        " seven"
    )
