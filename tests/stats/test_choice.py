"""Choices among alarms: what is named is right as often as promised, and what cannot be said is
not.
"""

import numpy as np
import pytest

from ravenjax.stats.alarms.choice import (
    AlarmCounts,
    alarms_within_limit,
    cheapest_alarms,
    factor_to_decide,
    false_rates,
    missed_difference,
    unbeaten_choices,
)
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.paired import difference_of_counts


def alarms(missed, count, hours):
    """missed: bool [hazards, alarms]."""
    missed = np.asarray(missed, bool)
    each = missed.astype(int)
    count = np.asarray(count)
    return AlarmCounts(
        each.sum(0),
        each.T @ (1 - each),
        len(each),
        count,
        np.broadcast_to(float(hours), count.shape),
    )


def nested(hazards, *shares):
    """Of so many hazards the first alarm misses the first share, the second more of the same .."""
    return np.arange(hazards)[:, None] < hazards * np.array(shares)


def test_intervals_are_those_of_pairs_and_of_exact_rates():
    missed = nested(200, 0.05, 0.1)
    counts = alarms(missed, [3, 0], 2.0)
    pair = difference_of_counts(10, 0, 200)
    estimate = missed_difference(counts)
    assert [part[1, 0] for part in estimate] == pytest.approx(list(pair))
    assert [part[0] for part in false_rates(counts)] == pytest.approx(list(alarm_rate(3, 2.0)[2:]))
    assert [part[0] for part in false_rates(counts, 10)] == pytest.approx(
        list(alarm_rate(30, 20.0)[2:])
    )


def test_enough_quiet_motion_decides():
    counts = alarms(nested(700, 0.05, 0.10, 0.16), [0, 0, 0], 7.4)
    assert cheapest_alarms(counts, 1000).tolist() == [True, False, False]
    possible, keeps = alarms_within_limit(counts, 0.5)
    assert possible.tolist() == [True, False, False] and keeps.all()
    assert not alarms_within_limit(counts, 0.49)[1].any()  # 3.689 / 7.4 h = 0.4985


def test_hours_that_decide_are_the_fewest():
    counts = alarms(nested(700, 0.05, 0.10), [0, 0], 0.01)
    times = factor_to_decide(lambda more: cheapest_alarms(counts, 100, more))
    low = missed_difference(counts).low[1, 0]
    assert 0.01 * times == pytest.approx(
        3.689 / (100 * low), rel=0.01
    )  # the first costs at most 3.689 / h more
    assert (
        not cheapest_alarms(counts, 100, times)[1] and cheapest_alarms(counts, 100, times / 1.02)[1]
    )


@pytest.mark.parametrize("weight", [10.0, 100.0])
def test_what_is_named_is_the_cheapest_as_often_as_promised(weight):
    """True cost of three alarms, and how often the cheapest is left out."""
    random = np.random.default_rng(0)
    share, rate = np.array([0.05, 0.15, 0.4]), np.array([4.0, 1.0, 0.2])
    best = int(np.argmin(weight * share + rate))
    wrong = decided = 0
    for _ in range(300):
        drawn = random.random(150)[:, None] < share
        counts = alarms(drawn, random.poisson(rate * 40.0), 40.0)
        possible = cheapest_alarms(counts, weight)
        wrong += not possible[best]
        decided += possible.sum() == 1
    assert wrong / 300 <= 0.05 and decided > 0


def by_definition(x, y):
    best = []
    for i in range(len(x)):
        beaten = (x <= x[i]) & (y <= y[i]) & ((x < x[i]) | (y < y[i]))
        best.append(not np.isnan(x[i] + y[i]) and not beaten.any())
    return best


@pytest.mark.parametrize("values", [6, 40, 10_000])
def test_as_defined(values):
    random = np.random.default_rng(values)
    for _ in range(50):
        x, y = random.integers(0, values, (2, 60)).astype(float)
        x[random.random(60) < 0.05] = np.nan
        assert unbeaten_choices(x, y).tolist() == by_definition(x, y)


def test_infinite_costs_and_no_choices():
    inf = np.inf
    assert unbeaten_choices([1, 2, inf], [inf, inf, 3]).tolist() == [True, False, True]
    assert (
        unbeaten_choices([inf, inf], [inf, inf]).tolist() == [True, True]
        and unbeaten_choices([], []).tolist() == []
    )
