"""What an arm can reach: nothing is left out without a word, and the scale is kept to."""

import re

import numpy as np
import pytest
from recorded_hands import HOME_MM, ROWS, play, recording, refused

from ravenjax.errors import UserError
from ravenjax.store.motion import replay


@pytest.fixture
def leaving(parquet):
    """A recording that leaves the workspace about 1.5 s, along the shaft through the remote
    centre.
    """
    frame = recording()
    away = np.clip(1.0 - np.abs(np.arange(ROWS) - 1500) / 150.0, 0.0, 1.0)
    away[:] = away * away * (3.0 - 2.0 * away)
    for i, axis in enumerate("xyz"):
        frame[f"gold_{axis}_um"] += 1e3 * HOME_MM[i] * 0.9 * -away
    return parquet(frame)


def test_what_cannot_be_reached_is_refused_with_how_much_where_and_why(leaving):
    """It used to take the longest stretch that can be reached, without a word."""
    message = refused(leaving, "an arm cannot reach the pose", "Of the poses from 0.000 to")
    assert re.search(
        r"insertion of gold would be at 4\d\d\.\d\d mm|joint would step|no joint positions", message
    )
    assert re.search(r"\d+ % cannot be reached within the soft joint limits", message)
    stretches = re.findall(
        r"\[(\d+\.\d+), (\d+\.\d+)\]", message.partition("These parts can be reached")[2]
    )
    assert len(stretches) >= 2 and "1.4" in stretches[0][1]
    for begin, end in stretches[:2]:  # what it says can be written
        one = play(leaving, window_s=(float(begin), float(end)))
        assert one.summary.window_s == pytest.approx((float(begin), float(end) - 1e-3))
        assert one.summary.arms[0].inside < 1.0 and one.summary.outside_share > 0.0


def test_a_scale_that_is_varied_beyond_the_limits_is_refused(parquet):
    one = play(parquet(recording()))
    replay.require_scales(one, np.array([0.05, 0.1, 0.2]))
    with pytest.raises(
        UserError, match=r"varied to 1 moves the tip 10 times as far as recorded\. At \d"
    ):
        replay.require_scales(one, np.array([0.1, 1.0]))
