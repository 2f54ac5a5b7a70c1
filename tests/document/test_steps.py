"""Step curves as drawn, by values: against the curve itself, asked at every x."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.document.steps import RESOLUTION, corners, steps


def value_at(x, values, at):
    """The step curve itself: the last value whose x is at most `at`."""
    return values[np.searchsorted(x, at, side="right") - 1]


def with_mass_at_zero(points, share=0.306):
    """Shares of an incidence [points]: `share` at 0 ms, then rising to 0.56; and its band."""
    time = np.concatenate([[0.0, 0.0], np.arange(1.0, points - 1)])
    line = np.concatenate(
        [[0.0, share], share + (0.56 - share) * np.linspace(0, 1, points - 2) ** 0.5]
    )
    return time, line, np.maximum(0, line - 0.02), np.minimum(1, line + 0.03)


@pytest.mark.parametrize("points", [3, 50, 10_000])
def test_a_curve_with_mass_at_zero_begins_with_it(points):
    time, *values = with_mass_at_zero(points)
    drawn = steps(time, *values, start=1.0, end=3e4)
    assert drawn.x[0] == 1.0 and drawn.x[-1] == 3e4
    assert [part[0] for part in drawn[1:]] == pytest.approx(
        [value_at(time, part, 1.0) for part in values]
    )
    assert drawn.y[0] >= 0.306
    plain = steps(time, *values)
    assert plain.x[:2].tolist() == [0, 0] and plain.y[:2].tolist() == pytest.approx([0, 0.306])


def test_ten_thousand_points_are_few_and_no_step_is_lost():
    time, *values = with_mass_at_zero(10_000)
    values[0][5000:] += 0.01  # a step in the middle
    drawn = steps(time, *values)
    assert len(drawn.x) < 3 / RESOLUTION
    everywhere = np.concatenate([time, time + 0.5])
    height = values[0].max()
    for part, original in zip(drawn[1:], values, strict=True):
        error = value_at(drawn.x, part, everywhere) - value_at(time, original, everywhere)
        assert np.abs(error).max() <= RESOLUTION * height < 0.005 * height
    at = time[5000]
    before, after = value_at(drawn.x, drawn.y, np.array([at - 1e-9, at]))
    assert after - before == pytest.approx(0.01, abs=RESOLUTION)


def test_the_band_holds_the_line_at_every_x():
    random = np.random.default_rng(3)
    time = np.sort(random.integers(0, 3000, 4000)).astype(float)
    line = np.sort(random.random(4000))
    drawn = steps(time, line, line * 0.9, np.minimum(1, line * 1.1 + 0.01), start=1.0, end=5000)
    assert (
        (drawn.low <= drawn.y).all()
        and (drawn.y <= drawn.high).all()
        and (np.diff(drawn.x) >= 0).all()
    )


def test_a_falling_curve_and_one_point():
    values = np.sort(np.random.default_rng(1).lognormal(size=20_000))
    above = 1 - np.arange(1, 20_001) / 20_000
    drawn = steps(values, above)
    at = np.geomspace(values[0], values[-1], 999)
    assert np.abs(value_at(drawn.x, drawn.y, at) - value_at(values, above, at)).max() <= RESOLUTION
    one = steps([0.0], [0.0], [0.0], [0.0], start=1.0, end=3000)
    assert one.x.tolist() == [1, 3000] and one.y.tolist() == [0, 0]


def test_corners_go_along_then_up():
    x, y = corners(np.array([0.0, 2, 5]), np.array([1.0, 3, 2]))
    assert list(zip(x, y, strict=True)) == [(0, 1), (2, 1), (2, 3), (5, 3), (5, 2)]


@pytest.mark.parametrize(
    ("x", "y", "message"),
    [([0, 1], [0.0], "one length"), ([], [], "at least 1"), ([1, 0], [0.0, 1.0], "must not fall")],
)
def test_what_is_no_curve_is_refused(x, y, message):
    with pytest.raises(ValueError, match=message):
        steps(x, y)
