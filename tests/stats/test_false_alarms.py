"""Rates of false alarms against exact values."""

from __future__ import annotations

import math

import pytest
from scipy.stats import poisson

from ravenjax.stats.alarms.false_alarms import alarm_rate


def test_known_poisson_interval():
    # Garwood 1936, table: 10 seen, 95 %: 4.795 to 18.39; none seen: up to 3.689
    assert alarm_rate(10, 2.0)[2:] == pytest.approx((5, 4.795 / 2, 18.39 / 2), rel=1e-3)
    assert alarm_rate(0, 1.0)[2:] == pytest.approx((0, 0, 3.689), rel=1e-3)


def test_coverage():
    for mean in (0.5, 3.0, 12.0):
        chance = poisson.pmf(range(60), mean)
        inside = [rate.low <= mean / 4 <= rate.high for rate in (alarm_rate(k, 4.0) for k in range(60))]
        assert 0.95 <= chance @ inside <= 1


def test_no_hours_have_no_rate():
    assert math.isnan(alarm_rate(0, 0.0).per_hour)
    with pytest.raises(ValueError, match="2 in 0 h"):
        alarm_rate(2, 0)
