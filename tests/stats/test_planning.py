"""Numbers of runs against the published table, and a stop rule against simulated peeking."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import norm

from ravenjax.stats.intervals import bounds, clopper_pearson, wilson
from ravenjax.stats.planning import StopRule, doubling_looks, more_runs, runs_for_half_width, runs_to_bound

# Leveugle et al., DATE 2009, rounds the quantiles of 90, 95 and 99 % so; its table follows from these alone
ROUNDED = {1.645: 0.90, 1.96: 0.95, 2.576: 0.99}


@pytest.mark.parametrize(
    ("half_width", "counts"),
    [
        (0.05, (271, 385, 664)),
        (0.03, (752, 1068, 1844)),
        (0.01, (6766, 9604, 16590)),
        (0.001, (676507, 960400, 1658944)),
    ],
)
def test_published_table(half_width, counts):
    for (t, confidence), count in zip(ROUNDED.items(), counts, strict=True):
        assert runs_for_half_width(half_width, 2 * norm.cdf(t) - 1) == count
        assert runs_for_half_width(half_width, confidence) == pytest.approx(count, rel=3e-4, abs=1)


@pytest.mark.parametrize(
    ("population", "half_width", "count"),
    [
        (1360, 0.05, 300),
        (1360, 0.03, 599),
        (1360, 0.01, 1192),
        (10**6, 0.05, 385),
        (10**6, 0.03, 1066),
        (10**6, 0.01, 9513),
    ],
)
def test_published_finite_populations(population, half_width, count):
    rounded = 2 * norm.cdf(1.96) - 1
    assert runs_for_half_width(half_width, rounded, population=population) == count
    assert abs(runs_for_half_width(half_width, 0.95, population=population) - count) <= 1


def test_no_more_runs_than_the_population_holds():
    assert runs_for_half_width(1e-6, population=50) == 50


@pytest.mark.parametrize("rate", [1e-2, 1e-3, 0.3])
def test_runs_to_bound_is_the_fewest(rate):
    n = runs_to_bound(rate)
    assert clopper_pearson(0, n, 0.9).high <= rate < clopper_pearson(0, n - 1, 0.9).high  # one-sided 95 %
    assert n <= 3 / rate


@pytest.mark.parametrize(("k", "n"), [(0, 20), (2, 100), (50, 100), (95, 100)])
def test_more_runs_are_the_fewest_that_do(k, n):
    more = more_runs(k, n, 0.02)
    total = n + more.expected
    low, high = bounds(k / n * np.array([total, total - 1]), np.array([total, total - 1]))
    enough, fewer = (high - low) / 2
    assert enough <= 0.02 < fewer
    assert more.safe >= more.expected


def test_safe_number_is_safe():
    random = np.random.default_rng(3)
    reached, tries = 0, 300
    for k in random.binomial(200, 0.1, tries):
        n = 200 + more_runs(int(k), 200, 0.02).safe
        final = wilson(int(k + random.binomial(n - 200, 0.1)), n)
        reached += (final.high - final.low) / 2 <= 0.02
    assert reached / tries > 0.95


def test_enough_runs_need_no_more():
    assert more_runs(50, 10_000, 0.05) == (0, 0)


def test_stop_rule_holds_whatever_look_it_stops_at():
    """A user who takes the look that misses the truth most, if any does, is still wrong at most 5 % of the time."""
    looks = doubling_looks(50, 1600)
    rule = StopRule(0.03, looks)
    naive = StopRule(0.03, looks, confidence=1 - 0.05 * len(looks))  # each look at 95 %, as if it were the only one
    random = np.random.default_rng(0)
    truth, tries = 0.1, 1000
    missed = {rule: 0, naive: 0}
    for run in random.random((tries, looks[-1])) < truth:
        seen = [int(run[:n].sum()) for n in looks]
        for one in missed:
            rates = [one.decide(n, [k], [n]).rates[0] for n, k in zip(looks, seen, strict=True)]
            missed[one] += any(not rate.low <= truth <= rate.high for rate in rates)
    assert missed[rule] / tries <= 0.05 < missed[naive] / tries


def test_stop_rule_stops_when_all_are_narrow():
    rule = StopRule(0.05, (100, 1000), groups=2)
    assert rule.look_confidence() == pytest.approx(1 - 0.05 / 4)
    early = rule.decide(100, [1, 10], [50, 50])
    assert not early.stop and not early.reached and early.widest > 0.05
    narrow = rule.decide(100, [0, 0], [400, 400])
    assert narrow.stop and narrow.reached and len(narrow.rates) == 2
    last = rule.decide(1000, [1, 0], [50, 0])
    assert last.stop and not last.reached and last.widest == 1.0


def test_unplanned_look_is_refused():
    with pytest.raises(ValueError, match="after 150 runs was not planned"):
        StopRule(0.05, (100, 1000)).decide(150, [1], [150])
    with pytest.raises(ValueError, match="increasing"):
        StopRule(0.05, (1000, 100)).decide(100, [1], [100])


def test_doubling_looks():
    assert doubling_looks(100, 1000) == (100, 200, 400, 800, 1000)
    assert doubling_looks(100, 800) == (100, 200, 400, 800) and doubling_looks(7, 7) == (7,)


@pytest.mark.parametrize(
    "call", [lambda: runs_for_half_width(0), lambda: runs_to_bound(1), lambda: more_runs(0, 0, 0.1)]
)
def test_bad_plans_are_refused(call):
    with pytest.raises(ValueError, match=r"fraction|no run"):
        call()
