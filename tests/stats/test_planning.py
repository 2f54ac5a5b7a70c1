"""Numbers of runs and hours against the intervals that they promise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.stats.alarms.false_alarms import alarm_rate, hours_to_bound
from ravenjax.stats.intervals import rate_bounds
from ravenjax.stats.sample_size.sequential import more_runs


@pytest.mark.parametrize("count", [0, 1, 7])
@pytest.mark.parametrize("per_hour", [0.5, 10])
def test_hours_to_bound_are_those_in_which_the_interval_ends_there(per_hour, count):
    assert alarm_rate(count, hours_to_bound(per_hour, count)).high == pytest.approx(per_hour)


def test_hours_without_an_alarm_by_hand():
    # a Poisson count with mean m shows none with chance exp(-m), which is 2.5 % at m = 3.689
    assert (
        hours_to_bound(0.5) == pytest.approx(-np.log(0.025) / 0.5) == pytest.approx(7.378, abs=1e-3)
    )


@given(st.floats(0, 1), st.integers(1, 10**6), st.floats(1e-4, 0.49), st.floats(0.5, 0.9999))
def test_more_runs_are_the_fewest_whatever_is_asked(rate, n, half_width, confidence):
    k = round(rate * n)
    total = n + more_runs(k, n, half_width, confidence).expected
    runs = np.array([total, total - 1.0])
    low, high = rate_bounds(k / n * runs, runs, 1 - confidence)
    enough, fewer = (high - low) / 2
    assert enough <= half_width * (1 + 1e-8) and (total == n or fewer > half_width * (1 - 1e-8))
