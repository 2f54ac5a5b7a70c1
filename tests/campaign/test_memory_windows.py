"""Rows into windows and blocks, all of them within the limits; blocks into parts."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.campaign.memory_windows import (
    SHARED,
    WindowLimits,
    assemble_parts,
    cut_into_windows,
    join_blocks,
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
    found = list(cut_into_windows(ranges, golden, acts, WindowLimits(lanes, ahead, most, alone)))
    np.testing.assert_array_equal(np.concatenate([window.rows for window in found]), rows)
    for window in found:
        places = np.concatenate(window.blocks)
        np.testing.assert_array_equal(np.sort(places), np.arange(len(window.rows)))
        own = window.rows[places]
        assert (np.diff(golden[own].astype(int) * 9 + acts[own]) >= 0).all(), (
            "neighbours act at about the same time"
        )
        assert len(np.unique(golden[window.rows])) <= most
        for block in window.blocks:
            different = len(np.unique(golden[window.rows[block]]))
            shared = different == 1 or different * SHARED <= len(block)
            assert len(block) <= lanes and (shared or len(block) <= min(most, alone))


@given(ranges(), st.integers(1, 50), st.integers(1, 40), SEED)
def test_parts_hold_the_rows_of_their_ranges(ranges, lanes, golden_runs, seed):
    """Also where the blocks of a window hold its rows in another order."""
    rows = np.concatenate([np.asarray(r) for r in ranges])
    golden = np.random.default_rng(seed).integers(0, golden_runs, rows[-1] + 1)

    def computed():
        for window in cut_into_windows(ranges, golden, golden, WindowLimits(lanes, 3, 20, 20)):
            blocks = [
                ({"row": window.rows[places]}, {"golden": golden[window.rows[places]]})
                for places in window.blocks
            ]
            yield join_blocks(window, blocks)

    found = list(assemble_parts(ranges, computed()))
    assert [part.rows for part in found] == ranges
    for part in found:
        np.testing.assert_array_equal(part.outcomes["row"], np.asarray(part.rows))
        np.testing.assert_array_equal(part.golden_runs["golden"], golden[np.asarray(part.rows)])
