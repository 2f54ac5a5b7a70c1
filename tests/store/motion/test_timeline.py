"""Which row of a recording is replayed when: rest, run-up, and what follows its end."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_hands import play, recording, refused

from ravenjax.store.motion import timeline
from ravenjax.store.motion.options import ReplayOptions

cases = st.tuples(st.integers(2, 4000), st.integers(501, 12_000), st.floats(0.1, 5.0))


def test_a_recording_that_ends_before_the_campaign_is_refused_with_what_to_write(parquet):
    """It used to leave the rest of the campaign without motion."""
    path = parquet(recording())
    message = refused(
        path, "ends after 3.749 s (3.000 s of the recording", "the campaign lasts 8 s", ticks=8000
    )
    for way in ("campaign.duration_s = 3.749", '"hold"', '"reverse"', "operator.slow_down = 2.42"):
        assert way in message
    assert len(play(path, ticks=8000, slow_down=2.42).motion) == 8000
    assert len(play(path, ticks=3749).motion) == 3749


@given(cases, st.sampled_from(["hold", "reverse"]))
def test_a_timeline_never_leaves_the_recording_and_never_jumps(case, at_end):
    rows, ticks, slow_down = case
    one = timeline.make_timeline(
        Path("m"), rows, ticks, ReplayOptions(slow_down=slow_down, at_end=at_end)
    )
    assert len(one.row) == len(one.pedal) == ticks
    assert one.row.min() >= 0.0 and one.row.max() <= rows - 1
    assert (one.row[:500] == 0.0).all()
    steps = np.diff(one.row)
    assert np.abs(steps).max() <= 1.0 / slow_down + 1e-9
    assert (one.end_s is None) == (ticks <= timeline.natural_ticks(rows, slow_down))
    if one.end_s is None or at_end == "hold":
        assert (steps >= -1e-12).all()
    if one.end_s is not None and ticks * 1e-3 >= one.end_s and at_end == "hold":
        assert one.row[-1] == pytest.approx(rows - 1)
