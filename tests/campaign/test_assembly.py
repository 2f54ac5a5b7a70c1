"""Blocks of rows into parts: every row where it belongs, each part as soon as it is whole."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.campaign import assembly
from ravenjax.campaign.assembly import Ordered


@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(1, 40)), min_size=1, max_size=12),
    st.integers(1, 50),
    st.integers(0, 2**32 - 1),
)
def test_parts_hold_the_rows_of_their_ranges(gaps_and_lengths, lanes, seed):
    """Also where a stretch is of blocks whose rows are in another order."""
    ranges, row, rng = [], 0, np.random.default_rng(seed)
    for gap, length in gaps_and_lengths:
        ranges.append(range(row + gap, row + gap + length))
        row += gap + length
    rows = np.concatenate([np.asarray(r) for r in ranges])
    stretches = []
    for i in range(0, len(rows), lanes):
        some = rows[i : i + lanes]
        places = rng.permutation(len(some))
        blocks = np.array_split(some[places], rng.integers(1, len(some) + 1))
        order = np.argsort(places)
        stretches.append(tuple(Ordered([{"row": b / half} for b in blocks], order) for half in (1, 2)))
    found = list(assembly.parts(ranges, stretches))
    assert [part.rows for part in found] == ranges
    for part in found:
        one, other = part.tables()
        np.testing.assert_array_equal(one["row"], np.asarray(part.rows))
        np.testing.assert_array_equal(other["row"], np.asarray(part.rows) / 2)


def test_a_part_is_there_as_soon_as_its_rows_are():
    told = []

    def blocks():
        for i in range(4):
            told.append(f"block {i}")
            yield (Ordered([{"row": np.arange(3 * i, 3 * i + 3)}], np.arange(3)),)

    for part in assembly.parts([range(0, 4), range(4, 5), range(5, 12)], blocks()):
        told.append(f"part to {part.rows.stop}")
    assert told == ["block 0", "block 1", "part to 4", "part to 5", "block 2", "block 3", "part to 12"]
