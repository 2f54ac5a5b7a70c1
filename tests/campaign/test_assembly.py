"""Blocks of rows into parts: every row where it belongs, each part as soon as it is whole."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.campaign import assembly


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(1, 40)), min_size=1, max_size=12), st.integers(1, 50))
def test_parts_hold_the_rows_of_their_ranges(gaps_and_lengths, lanes):
    ranges, row = [], 0
    for gap, length in gaps_and_lengths:
        ranges.append(range(row + gap, row + gap + length))
        row += gap + length
    rows = np.concatenate([np.asarray(r) for r in ranges])
    blocks = [({"row": rows[i : i + lanes]}, {"half": rows[i : i + lanes] / 2}) for i in range(0, len(rows), lanes)]
    found = list(assembly.parts(ranges, blocks))
    assert [part.rows for part in found] == ranges
    for part in found:
        one, other = part.tables()
        np.testing.assert_array_equal(one["row"], np.asarray(part.rows))
        np.testing.assert_array_equal(other["half"], np.asarray(part.rows) / 2)


def test_a_part_is_there_as_soon_as_its_rows_are():
    told = []

    def blocks():
        for i in range(4):
            told.append(f"block {i}")
            yield ({"row": np.arange(3 * i, 3 * i + 3)},)

    for part in assembly.parts([range(0, 4), range(4, 5), range(5, 12)], blocks()):
        told.append(f"part to {part.rows.stop}")
    assert told == ["block 0", "block 1", "part to 4", "part to 5", "block 2", "block 3", "part to 12"]
