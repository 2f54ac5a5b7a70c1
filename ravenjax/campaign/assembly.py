"""From blocks back to parts: columns of blocks of rows, cut and joined to the columns of each part."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np

Tables = tuple[Mapping[str, np.ndarray], ...]
"""Columns by name, all of the same rows."""


class PartRows(NamedTuple):
    """The rows of one part, and the pieces of blocks that hold them."""

    rows: range
    pieces: list[tuple[Tables, slice]]

    def tables(self) -> tuple[dict[str, np.ndarray], ...]:
        """The columns of all its rows."""
        return tuple(
            {name: np.concatenate([tables[t][name][where] for tables, where in self.pieces]) for name in table}
            for t, table in enumerate(self.pieces[0][0])
        )


def parts(ranges: Iterable[range], blocks: Iterable[Tables]) -> Iterator[PartRows]:
    """Each of `ranges` as soon as its rows are there; `blocks` hold the rows of all in order, none missing."""
    wanted = iter(ranges)
    part, room = PartRows(range(0), []), 0
    for block in blocks:
        size, first = len(next(iter(block[0].values()))), 0
        while first < size:
            if not room:
                part = PartRows(next(wanted), [])
                room = len(part.rows)
            piece = slice(first, min(size, first + room))
            part.pieces.append((block, piece))
            first, room = piece.stop, room - (piece.stop - first)
            if not room:
                yield part
