"""Blocks of rows into parts: every row where it belongs, each part as soon as it is whole."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.campaign import assembly
from ravenjax.campaign.assembly import StretchTable


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
        tables = StretchTable(len(some)), StretchTable(len(some))
        for block in np.array_split(places, rng.integers(1, len(some) + 1)):
            for half, table in enumerate(tables, start=1):
                table.put(block, {"row": some[block] / half})
        stretches.append(tables)
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
            table = StretchTable(3)
            table.put(np.arange(3), {"row": np.arange(3 * i, 3 * i + 3)})
            yield (table,)

    for part in assembly.parts([range(0, 4), range(4, 5), range(5, 12)], blocks()):
        told.append(f"part to {part.rows.stop}")
    assert told == [
        "block 0",
        "block 1",
        "part to 4",
        "part to 5",
        "block 2",
        "block 3",
        "part to 12",
    ]


@given(
    st.lists(
        st.tuples(st.integers(1, 5), st.sampled_from([1.0, 2.0, np.nan, None])),
        min_size=1,
        max_size=6,
    )
)
def test_columns_of_one_value_stay_one_number_until_another_comes(blocks):
    """None: a block of different values."""
    rows = sum(size for size, _ in blocks)
    table, expected, first = StretchTable(rows), np.zeros(rows), 0
    for size, value in blocks:
        places = np.arange(first, first + size)
        expected[places] = 10.0 + places if value is None else value
        block = expected[places] if value is None else np.broadcast_to(np.array([value]), size)
        table.put(places, {"column": block})
        first += size
    np.testing.assert_array_equal(table["column"], expected)
    alike = None not in (values := {value for _, value in blocks}) and len(values) == 1
    assert (table["column"].strides == (0,)) == alike or rows == 1
