"""Effect sizes against closed forms, published examples and simulated coverage."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from ravenjax.stats.comparison import effect_size


def test_hedges_g_is_cohens_d_without_its_bias():
    one, two = np.array([3.0, 4, 5, 6, 7]), np.array([1.0, 2, 3, 4, 5])
    found = effect_size.hedges_g(one, two)
    d = 2 / math.sqrt(2.5)
    assert found.value == pytest.approx(
        d * (1 - 3 / (4 * 8 - 1)), rel=1e-3
    )  # Hedges' approximation of his factor
    t = stats.ttest_ind(one, two).statistic
    factor = found.value / d
    scale = math.sqrt(5 * 5 / 10)
    assert stats.nct.sf(t, 8, found.low / factor * scale) == pytest.approx(0.025, abs=1e-6)
    assert stats.nct.cdf(t, 8, found.high / factor * scale) == pytest.approx(0.025, abs=1e-6)


def test_an_interval_holds_zero_exactly_where_the_t_test_does_not_reject():
    random = np.random.default_rng(0)
    for shift in (0.0, 0.6, 1.2):
        one, two = random.normal(shift, 1, 12), random.normal(0, 1, 9)
        found = effect_size.hedges_g(one, two)
        assert (found.low > 0 or found.high < 0) == (stats.ttest_ind(one, two).pvalue < 0.05)
        pairs = effect_size.paired_g(one[:9], two)
        assert (pairs.low > 0 or pairs.high < 0) == (stats.ttest_rel(one[:9], two).pvalue < 0.05)


@pytest.mark.slow
@pytest.mark.parametrize("true", [0.0, 0.8])
def test_intervals_cover(true):
    random = np.random.default_rng(1)
    held = {"g": 0, "paired": 0}
    runs = 1000
    for _ in range(runs):
        one, two = random.normal(true, 1, 15), random.normal(0, 1, 12)
        g = effect_size.hedges_g(one, two)
        p = effect_size.paired_g(one[:12] + 0.0, np.zeros(12))
        held["g"] += g.low <= true <= g.high
        held["paired"] += p.low <= true <= p.high
    for name, count in held.items():
        assert 0.925 < count / runs < 0.98, name


def test_what_has_no_effect_size():
    assert math.isnan(effect_size.hedges_g([1.0], [2.0, 3.0]).value)
    assert math.isnan(effect_size.hedges_g([1.0, 1.0], [1.0, 1.0]).value)
    with pytest.raises(ValueError, match="finite"):
        effect_size.hedges_g([1.0, math.nan], [2.0, 3.0])
    with pytest.raises(ValueError, match="one by one"):
        effect_size.paired_g([1.0, 2.0], [2.0])
