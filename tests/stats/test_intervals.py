"""Intervals against published values, closed forms and simulated coverage."""

import numpy as np
import pytest
from scipy.stats import binom, binomtest

from ravenjax.stats.intervals import (
    clopper_pearson,
    rate_difference,
    rates_with_intervals,
    wilson_interval,
)


@pytest.mark.parametrize(
    ("interval", "name"), [(wilson_interval, "wilson"), (clopper_pearson, "exact")]
)
def test_rates_are_scipys(interval, name):
    for k in range(0, 301, 7):
        rate, theirs = interval(k, 300), binomtest(k, 300).proportion_ci(0.95, name)
        assert (rate.low, rate.high) == pytest.approx((theirs.low, theirs.high), abs=1e-12)


def exact_coverage(interval, n, chances):
    """Chance that the interval holds p, for each p: a sum over all outcomes, no sampling error."""
    k = np.arange(n + 1)
    low, high = np.array([interval(hits, n)[3:] for hits in k.tolist()]).T
    return [float(binom.pmf(k, n, p)[(low <= p) & (p <= high)].sum()) for p in chances]


@pytest.mark.parametrize("n", [20, 170])
def test_coverage(n):
    chances = np.linspace(0.02, 0.98, 49)
    exact, score = (exact_coverage(one, n, chances) for one in (clopper_pearson, wilson_interval))
    assert min(exact) >= 0.95
    assert np.mean(score) == pytest.approx(0.95, abs=0.01) and min(score) > 0.83


@pytest.mark.parametrize(("k", "n"), [(3, 2), (-1, 2), (0, -1)])
def test_impossible_counts_are_refused(k, n):
    with pytest.raises(ValueError, match=f"k = {k}, n = {n}"):
        wilson_interval(k, n)


def test_no_trials_have_no_rate():
    assert (
        np.isnan(wilson_interval(0, 0)[2:]).all()
        and wilson_interval(0, 0) == rates_with_intervals([1, 0], [2, 0])[1]
    )


@pytest.mark.parametrize("confidence", [0, 1, 95])
def test_impossible_confidence_is_refused(confidence):
    with pytest.raises(ValueError, match=str(confidence)):
        rates_with_intervals(1, 2, confidence)


def test_published_difference():
    # Newcombe 1998, table II: 56/70 - 48/80, method 10: 0.0524 to 0.3339
    assert rate_difference(56, 70, 48, 80) == pytest.approx((0.2, 0.0524, 0.3339), abs=5e-5)


def test_a_difference_covers_over_all_outcomes():
    """Chance that the interval holds the truth, a sum over all pairs of outcomes."""
    n1, n2 = 30, 40
    for p1, p2 in ((0.1, 0.4), (0.5, 0.5), (0.05, 0.05)):
        chance = np.outer(binom.pmf(range(n1 + 1), n1, p1), binom.pmf(range(n2 + 1), n2, p2))
        held = 0.0
        for k1, k2 in np.argwhere(chance > 1e-4):
            difference = rate_difference(k1, n1, k2, n2)
            held += chance[k1, k2] * (difference.low <= p1 - p2 <= difference.high)
        assert 0.935 < held / chance[chance > 1e-4].sum() < 0.995, (p1, p2, held)
