"""Rates of false alarms and the thresholds that keep them, against exact values and simulated operation."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import expon, poisson

from ravenjax.stats.alarms.false_alarms import alarm_rate, threshold_for_rate


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


def test_threshold_lets_just_enough_pass():
    score = np.array([9.0, 7.0, 7.0, 5.0, 3.0, -np.inf])
    for per_hour, least, count in (
        (0.1, 9, 0),
        (0.25, 7, 1),
        (0.5, 7, 1),
        (0.75, 5, 3),
        (1.0, 3, 4),
        (1.25, -np.inf, 5),
    ):
        found = threshold_for_rate(score, 4.0, per_hour)
        assert found.threshold == np.nextafter(least, np.inf) and found.false_alarms.count == count
        assert found.false_alarms.per_hour <= per_hour
    assert threshold_for_rate(score, 4.0, 10).threshold == -np.inf  # each run may alarm, and those that can do
    assert threshold_for_rate(score, 4.0, 10).false_alarms.count == 5


def test_assured_threshold_holds_as_often_as_promised():
    """Runs come at 100 an hour and score Exp(1), so a threshold t alarms at 100 exp(-t) per hour."""
    random = np.random.default_rng(0)
    wanted, hours, tries = 2.0, 5.0, 1200
    above = {True: 0, False: 0}
    for _ in range(tries):
        score = random.exponential(size=random.poisson(100 * hours))
        for assured in above:
            found = threshold_for_rate(score, hours, wanted, 0.9, assured=assured)
            above[assured] += 100 * expon.sf(found.threshold) > wanted
    allowed = next(m for m in range(20) if poisson.cdf(m + 1, wanted * hours) > 0.1)
    assert above[True] / tries == pytest.approx(poisson.cdf(allowed, wanted * hours), abs=0.03)  # below 0.1
    assert above[True] / tries < 0.1 < above[False] / tries


def test_too_few_hours_are_told():
    with pytest.raises(ValueError, match="at least 30 h"):
        threshold_for_rate(np.zeros(10), 20.0, 0.1, assured=True)  # -ln(0.05) / 0.1 = 29.96
    assert threshold_for_rate(np.zeros(10), 30.0, 0.1, assured=True).false_alarms.count == 0


def test_runs_that_always_alarm_are_told():
    with pytest.raises(ValueError, match="2 fault-free runs alarm at any threshold"):
        threshold_for_rate(np.array([np.inf, np.inf, 1.0]), 1.0, 1.0)
    assert threshold_for_rate(np.array([np.inf, np.inf, 1.0]), 1.0, 2.0).false_alarms.count == 2


@pytest.mark.parametrize(("score", "hours", "message"), [([np.nan], 1, "NaN"), ([1.0], 0, "hours > 0")])
def test_bad_input_is_refused(score, hours, message):
    with pytest.raises(ValueError, match=message):
        threshold_for_rate(np.array(score), hours, 1.0)
