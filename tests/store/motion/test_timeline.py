"""Which row of a recording is replayed when: rest, run-up, and what follows its end."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from recorded_hands import play, recording, refused, tip_mm

from ravenjax.errors import UserError
from ravenjax.store.motion import timeline
from ravenjax.store.motion.options import ReplayOptions

cases = st.tuples(st.integers(2, 4000), st.integers(501, 12_000), st.floats(0.1, 5.0))


def test_a_recording_that_ends_before_the_campaign_is_refused_with_what_to_write(parquet):
    """It used to leave the rest of the campaign without motion."""
    path = parquet(recording())
    message = refused(
        path, "ends after 3.749 s, 3.000 s of the recording", "the campaign lasts 8 s", ticks=8000
    )
    for way in ("campaign.duration_s = 3.749", '"hold"', '"reverse"', "operator.slow_down = 2.42"):
        assert way in message
    assert len(play(path, ticks=8000, slow_down=2.42).motion) == 8000
    assert len(play(path, ticks=3749).motion) == 3749


def test_hold_slows_down_and_rests(parquet):
    one = play(parquet(recording(rows=2300)), ticks=6000, at_end="hold")
    tip = tip_mm(one.motion)
    assert one.summary.end_s == pytest.approx(0.5 + 2.3 + 0.5, abs=2e-3) and one.summary.turns == 0
    assert np.abs(np.diff(tip[3302:], axis=0)).max() == 0.0
    speed = np.linalg.norm(np.diff(tip, axis=0), axis=1)
    assert np.abs(np.diff(speed)).max() < 1e-3  # comes to rest without a jolt, mm per ms
    assert tip[-1] == pytest.approx(
        tip_mm(play(parquet(recording(rows=2300))).motion)[-1], abs=1e-6
    )


def test_reverse_goes_back_and_forth(parquet):
    one = play(parquet(recording(rows=2300)), ticks=10_000, at_end="reverse")
    tip, there = tip_mm(one.motion), 2299 + 500
    assert one.summary.turns == 3
    assert tip[500 + 2 * there - 1] == pytest.approx([0.0, 0.0, 0.0], abs=1e-3)  # back at the start
    np.testing.assert_allclose(
        tip[500 : 500 + there], tip[500 + there : 500 + 2 * there][::-1], atol=1e-9
    )
    speed = np.linalg.norm(np.diff(tip, axis=0), axis=1)
    assert np.abs(np.diff(speed)).max() < 1e-3
    assert speed[-1000:].max() > 0.01  # it still moves


def test_a_campaign_that_ends_before_hands_move_is_refused(parquet):
    refused(
        parquet(recording()),
        "the campaign ends after 0.3 s, and hands rest for the first 0.5 s",
        ticks=300,
    )


@given(cases, st.sampled_from(["hold", "reverse"]))
def test_a_timeline_never_leaves_the_recording_and_never_jumps(case, at_end):
    rows, ticks, slow_down = case
    one = timeline.make(Path("m"), rows, ticks, ReplayOptions(slow_down=slow_down, at_end=at_end))
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


@given(st.tuples(st.integers(300, 4000), st.integers(501, 12_000), st.floats(0.1, 5.0)))
def test_what_a_refusal_says_is_accepted(case):
    rows, ticks, slow_down = case
    try:
        timeline.make(Path("m"), rows, ticks, ReplayOptions(slow_down=slow_down))
    except UserError as error:
        words = str(error).replace(",", " ").split()
        shorter = round(float(words[words.index("campaign.duration_s") + 2]) * 1e3)
        slower = float(words[-1])
        assert (
            len(timeline.make(Path("m"), rows, shorter, ReplayOptions(slow_down=slow_down)).row)
            == shorter
        )
        assert (
            len(timeline.make(Path("m"), rows, ticks, ReplayOptions(slow_down=slower)).row) == ticks
        )
