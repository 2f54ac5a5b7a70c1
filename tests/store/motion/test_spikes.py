"""Jumps of a recorded tip: found by row, time and size, refused, or treated as the campaign
says; never lost.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from recorded_hands import ROWS, play, recording, refused

from ravenjax.store.motion import spikes
from ravenjax.store.motion.track import ArmTrack


def test_a_spike_is_refused_with_row_time_and_what_to_write(parquet):
    """50 mm in one sample used to vanish in the low-pass."""
    frame = recording()
    frame.loc[1500, "gold_z_um"] += 50e3
    path = parquet(frame)
    refused(
        path,
        "the tip jumps at row 1500 (1.500 s, gold): 50 mm.",
        'operator.spikes = "remove"',
        "window_s",
    )
    refused(path, "row 1500", cutoff_hz=5.0)


def test_a_tip_that_does_not_come_back_cannot_be_removed(parquet):
    frame = recording()
    frame.loc[1500:, "gold_z_um"] += 10_000.0
    path = parquet(frame)
    message = refused(
        path, "row 1500 (1.500 s, gold): 10 mm, without jumping back", spikes="remove"
    )
    assert '"remove"' not in message and "operator.window_s selects a part" in message
    assert play(path, window_s=(1.5, 3.0)).motion.duration_s == pytest.approx(2.25, abs=2e-3)


@settings(max_examples=60)
@given(
    st.integers(1, ROWS - 2 - spikes.MOST_ROWS),
    st.integers(1, spikes.MOST_ROWS - 1),
    st.floats(3.0, 300.0),
    st.sampled_from([0, 1, 2]),
)
def test_every_spike_is_found_where_it_is(row, rows, size_mm, axis):
    frame = recording()[["gold_x_um", "gold_y_um", "gold_z_um"]].to_numpy() * 1e-6
    place = frame.copy()
    place[row : row + rows, axis] += size_mm * 1e-3
    time_s = np.arange(ROWS) * 1e-3
    (found,) = spikes.find_spikes("gold", ArmTrack(None, place, None, None), time_s, 0.1)
    assert (found.row, found.rows) == (row, rows)
    assert found.time_s == pytest.approx(row * 1e-3)
    assert found.size_mm == pytest.approx(size_mm, abs=0.5)
    rest, times = spikes.remove_spikes(ArmTrack(None, place, None, None), time_s, [found])
    assert len(rest) == ROWS - rows
    np.testing.assert_array_equal(rest.position, frame[np.rint(times * 1e3).astype(int)])
