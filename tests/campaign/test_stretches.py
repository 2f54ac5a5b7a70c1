"""Rows into stretches and blocks: all of them, within the limits."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.campaign import stretches
from ravenjax.campaign.stretches import StretchLimits

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
    found = list(stretches.cut(ranges, golden, StretchLimits(lanes, ahead, most, alone), acts))
    np.testing.assert_array_equal(np.concatenate([stretch.rows for stretch in found]), rows)
    for stretch in found:
        places = np.concatenate(stretch.blocks)
        np.testing.assert_array_equal(np.sort(places), np.arange(len(stretch.rows)))
        own = stretch.rows[places]
        assert (np.diff(golden[own].astype(int) * 9 + acts[own]) >= 0).all(), (
            "neighbours act at about the same time"
        )
        np.testing.assert_array_equal(stretch.golden_runs, np.unique(golden[stretch.rows]))
        assert len(stretch.golden_runs) <= most
        for block in stretch.blocks:
            different = len(np.unique(golden[stretch.rows[block]]))
            shared = different == 1 or different * stretches.SHARED <= len(block)
            assert len(block) <= lanes and (shared or len(block) <= min(most, alone))


def test_blocks_are_full_where_a_golden_run_is_shared():
    found = list(
        stretches.cut(
            [range(0, 70), range(80, 1000)], np.zeros(1000, int), StretchLimits(64, 4, 1, 1)
        )
    )
    assert [len(block) for stretch in found for block in stretch.blocks] == [64] * 15 + [30]
    assert [len(stretch.blocks) for stretch in found] == [4, 4, 4, 4]
