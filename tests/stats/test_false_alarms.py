"""Rates of false alarms against exact values."""

import math

import numpy as np
import pytest
from scipy.stats import poisson

from ravenjax.stats.alarms.false_alarms import alarm_rate, ending_rate, hours_to_bound


def test_known_poisson_interval():
    # Garwood 1936, table: 10 seen, 95 %: 4.795 to 18.39; none seen: up to 3.689
    assert alarm_rate(10, 2.0)[2:] == pytest.approx((5, 4.795 / 2, 18.39 / 2), rel=1e-3)
    assert alarm_rate(0, 1.0)[2:] == pytest.approx((0, 0, 3.689), rel=1e-3)


def test_coverage():
    for mean in (0.5, 3.0, 12.0):
        chance = poisson.pmf(range(60), mean)
        inside = [
            rate.low <= mean / 4 <= rate.high for rate in (alarm_rate(k, 4.0) for k in range(60))
        ]
        assert 0.95 <= chance @ inside <= 1


def test_no_hours_have_no_rate():
    assert math.isnan(alarm_rate(0, 0.0).per_hour)


def test_where_alarms_end_operations_their_rate_is_not_bounded_by_one_an_operation():
    rng = np.random.default_rng(3)
    per_hour, length = 40.0, 0.1  # four alarms an operation, were they not to end it
    alarm = rng.random(4000) < 1 - np.exp(-per_hour * length)
    # P(alarm) over P(none) times the hours of an operation
    truth = (np.exp(per_hour * length) - 1) / length
    rate = ending_rate(alarm, np.full(4000, length))
    assert rate.low < truth < rate.high and rate.per_hour > 10 / length
    assert rate.hours == pytest.approx(length * (~alarm).sum())


def test_no_hours_have_no_rate_and_alarms_alone_an_infinite_one():
    assert np.isnan(ending_rate(np.zeros(0, bool), np.zeros(0)).per_hour)
    rate = ending_rate(np.ones(5, bool), np.full(5, 0.1))
    assert rate.per_hour == rate.high == np.inf and 0 < rate.low < np.inf


@pytest.mark.parametrize("count", [0, 1, 7])
@pytest.mark.parametrize("per_hour", [0.5, 10])
def test_hours_to_bound_are_those_in_which_the_interval_ends_there(per_hour, count):
    assert alarm_rate(count, hours_to_bound(per_hour, count)).high == pytest.approx(per_hour)
