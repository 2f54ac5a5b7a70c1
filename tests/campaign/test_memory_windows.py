"""Rows into windows and blocks, all of them within the limits; blocks into parts."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.campaign.memory_windows import (
    SHARED,
    WindowLimits,
    WindowTable,
    assemble_parts,
    cut_into_windows,
)

SEED = st.integers(0, 9)


@st.composite
def ranges(draw):
    """Ascending ranges of rows, some with gaps between."""
    steps = draw(
        st.lists(st.tuples(st.integers(0, 3), st.integers(1, 40)), min_size=1, max_size=12)
    )
    out, row = [], 0
    for gap, length in steps:
        out.append(range(row + gap, row + gap + length))
        row += gap + length
    return out


@given(
    ranges(),
    st.integers(1, 50),
    st.tuples(*[st.integers(1, 30)] * 2),
    st.integers(1, 5),
    st.integers(1, 40),
    SEED,
)
def test_every_row_is_in_one_block_and_nothing_is_too_large(
    ranges, lanes, limits, ahead, golden_runs, seed
):
    most, alone = limits
    rows = np.concatenate([np.asarray(r) for r in ranges])
    golden = np.random.default_rng(seed).integers(0, golden_runs, rows[-1] + 1)
    acts = np.random.default_rng(seed + 1).integers(0, 9, rows[-1] + 1)
    found = list(cut_into_windows(ranges, golden, WindowLimits(lanes, ahead, most, alone), acts))
    np.testing.assert_array_equal(np.concatenate([window.rows for window in found]), rows)
    for window in found:
        places = np.concatenate(window.blocks)
        np.testing.assert_array_equal(np.sort(places), np.arange(len(window.rows)))
        own = window.rows[places]
        assert (np.diff(golden[own].astype(int) * 9 + acts[own]) >= 0).all(), (
            "neighbours act at about the same time"
        )
        np.testing.assert_array_equal(window.golden_runs, np.unique(golden[window.rows]))
        assert len(window.golden_runs) <= most
        for block in window.blocks:
            different = len(np.unique(golden[window.rows[block]]))
            shared = different == 1 or different * SHARED <= len(block)
            assert len(block) <= lanes and (shared or len(block) <= min(most, alone))


def test_blocks_are_full_where_a_golden_run_is_shared():
    found = list(
        cut_into_windows(
            [range(0, 70), range(80, 1000)], np.zeros(1000, int), WindowLimits(64, 4, 1, 1)
        )
    )
    assert [len(block) for window in found for block in window.blocks] == [64] * 15 + [30]
    assert [len(window.blocks) for window in found] == [4, 4, 4, 4]


@given(
    st.lists(st.tuples(st.integers(0, 3), st.integers(1, 40)), min_size=1, max_size=12),
    st.integers(1, 50),
    st.integers(0, 2**32 - 1),
)
def test_parts_hold_the_rows_of_their_ranges(gaps_and_lengths, lanes, seed):
    """Also where a window is of blocks whose rows are in another order."""
    ranges, row, rng = [], 0, np.random.default_rng(seed)
    for gap, length in gaps_and_lengths:
        ranges.append(range(row + gap, row + gap + length))
        row += gap + length
    rows = np.concatenate([np.asarray(r) for r in ranges])
    windows = []
    for i in range(0, len(rows), lanes):
        some = rows[i : i + lanes]
        places = rng.permutation(len(some))
        tables = WindowTable(len(some)), WindowTable(len(some))
        for block in np.array_split(places, rng.integers(1, len(some) + 1)):
            for half, table in enumerate(tables, start=1):
                table.put(block, {"row": some[block] / half})
        windows.append(tables)
    found = list(assemble_parts(ranges, windows))
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
            table = WindowTable(3)
            table.put(np.arange(3), {"row": np.arange(3 * i, 3 * i + 3)})
            yield (table,)

    for part in assemble_parts([range(0, 4), range(4, 5), range(5, 12)], blocks()):
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
    table, expected, first = WindowTable(rows), np.zeros(rows), 0
    for size, value in blocks:
        places = np.arange(first, first + size)
        expected[places] = 10.0 + places if value is None else value
        block = expected[places] if value is None else np.broadcast_to(np.array([value]), size)
        table.put(places, {"column": block})
        first += size
    np.testing.assert_array_equal(table["column"], expected)
    alike = None not in (values := {value for _, value in blocks}) and len(values) == 1
    assert (table["column"].strides == (0,)) == alike or rows == 1
