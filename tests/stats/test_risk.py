"""Two independent rates, against published values, symmetry and exact coverage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import binom

from ravenjax.stats.comparison.independent import compare


def test_published_difference():
    # Newcombe 1998, table II: 56/70 - 48/80, method 10: 0.0524 to 0.3339
    found = compare(56, 70, 48, 80)
    assert found.difference == pytest.approx((0.2, 0.0524, 0.3339), abs=5e-5)


def test_ratio_turns_over_with_the_groups():
    for one, other in (((12, 50), (5, 60)), ((1, 40), (39, 40)), ((50, 50), (3, 60))):
        there, back = compare(*one, *other), compare(*other, *one)
        assert there.ratio == pytest.approx((1 / back.ratio.value, 1 / back.ratio.high, 1 / back.ratio.low))
        assert there.difference == pytest.approx((-back.difference.value, -back.difference.high, -back.difference.low))
        assert there.p == pytest.approx(back.p)


def test_coverage_over_all_outcomes():
    """Chance that each interval holds the truth, a sum over all pairs of outcomes."""
    n1, n2 = 30, 40
    for p1, p2 in ((0.1, 0.4), (0.5, 0.5), (0.05, 0.05)):
        chance = np.outer(binom.pmf(range(n1 + 1), n1, p1), binom.pmf(range(n2 + 1), n2, p2))
        held = np.zeros(2)
        for k1, k2 in np.argwhere(chance > 1e-4):
            found = compare(k1, n1, k2, n2)
            truth = (p1 - p2, p1 / p2)
            held += chance[k1, k2] * np.array(
                [one.low <= is_ <= one.high for one, is_ in zip((found.difference, found.ratio), truth, strict=True)]
            )
        held /= chance[chance > 1e-4].sum()
        assert (held > 0.935).all() and held.max() < 0.995, (p1, p2, held)


def test_counts_of_none():
    found = compare(3, 50, 0, 60)
    assert found.ratio.value == math.inf and found.ratio.high == math.inf and found.ratio.low > 0.5
    both = compare(0, 50, 0, 60)
    assert math.isnan(both.ratio.value) and (both.ratio.low, both.ratio.high) == (0, math.inf) and both.p == 1
    assert both.difference.low < 0 < both.difference.high
    all_ = compare(50, 50, 60, 60)
    assert all_.ratio.low < 1 == all_.ratio.value < all_.ratio.high
    assert np.isnan(compare(0, 0, 1, 2).difference).all()


def test_clear_difference_has_a_small_p():
    assert compare(40, 50, 10, 50).p < 1e-8 and compare(10, 50, 10, 50).p == pytest.approx(1)
