"""Comparisons of clustered groups: closed forms where clusters have one row, simulated coverage
else.
"""

import math

import numpy as np
import pytest
from scipy import stats

from analysis.training import clustered
from ravenjax.stats import intervals


def singles(values):
    return [np.array([value]) for value in values]


def drawn(random, clusters, rows, rate, icc):
    """Clusters of bool rows with a beta-binomial law of this intraclass correlation."""
    weight = (1 - icc) / icc
    each = random.beta(rate * weight, (1 - rate) * weight, clusters)
    return [random.random(rows) < p for p in each]


def test_one_row_a_cluster_is_the_usual_interval():
    first, second = [True] * 9 + [False] * 3, [True] * 4 + [False] * 10
    found = clustered.risk_difference(singles(first), singles(second))
    usual = intervals.rate_difference(9, 12, 4, 14)
    assert found == pytest.approx(usual, abs=1e-12)
    # Newcombe 1998, table II: 56/70 - 48/80, method 10: 0.0524 to 0.3339
    newcombe = clustered.risk_difference(singles([1] * 56 + [0] * 14), singles([1] * 48 + [0] * 32))
    assert newcombe == pytest.approx((0.2, 0.0524, 0.3339), abs=5e-5)
    values = np.random.default_rng(0).normal(size=(2, 10))
    mean = clustered.mean_difference(singles(values[0]), singles(values[1]))
    welch = stats.ttest_ind(*values, equal_var=False).confidence_interval()
    assert mean == pytest.approx((values[0].mean() - values[1].mean(), *welch))


def test_correlation_of_what_is_alike_and_of_what_is_not():
    alike = [np.full(4, float(i)) for i in range(6)]
    found = clustered.intraclass_correlation(alike)
    assert found.icc == pytest.approx(1) and found.design_effect == pytest.approx(4)
    random = np.random.default_rng(3)
    shared, own = random.normal(0, 1, 3000), random.normal(0, 1, (3000, 5))
    found = clustered.intraclass_correlation(
        list(shared[:, None] * math.sqrt(0.3) + own * math.sqrt(0.7))
    )
    assert found.icc == pytest.approx(0.3, abs=0.03) and found.design_effect == pytest.approx(
        1 + 4 * found.icc
    )
    assert math.isnan(clustered.intraclass_correlation(singles([1.0, 2.0])).icc)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("clusters", "rows", "rates", "icc"), [(8, 4, (0.8, 0.4), 0.3), (20, 3, (0.95, 0.7), 0.2)]
)
def test_the_risk_difference_covers_where_the_usual_one_does_not(clusters, rows, rates, icc):
    random = np.random.default_rng(7)
    held = usual = 0
    runs = 600
    true = rates[0] - rates[1]
    for _ in range(runs):
        first, second = (drawn(random, clusters, rows, rate, icc) for rate in rates)
        found = clustered.risk_difference(first, second)
        held += found.low <= true <= found.high
        counts = [int(sum(one.sum() for one in group)) for group in (first, second)]
        plain = intervals.rate_difference(counts[0], clusters * rows, counts[1], clusters * rows)
        usual += plain.low <= true <= plain.high
    assert 0.925 < held / runs < 0.99 and usual < held


@pytest.mark.slow
def test_permutation_rejects_no_more_than_promised_under_the_null_and_finds_what_is_there():
    random = np.random.default_rng(5)
    p = []
    for _ in range(200):
        first, second = (drawn(random, 6, 4, 0.5, 0.4) for _ in range(2))
        p.append(clustered.permutation_p(first, second))
    assert np.mean(np.array(p) <= 0.05) <= 0.085  # 0.05 + 2.3 standard errors
    shifted = [np.full(3, 5.0) + i for i in range(6)], [np.full(3, 0.0) + i * 0.1 for i in range(6)]
    assert clustered.permutation_p(*shifted) == pytest.approx(
        2 / math.comb(12, 6)
    )  # exact: the most extreme of all
    assert clustered.permutation_p(*shifted, is_paired=True) == pytest.approx(2 / 2**6)
    assert math.isnan(clustered.permutation_p(singles([1.0]), singles([1.0, 2.0])))


def test_pairs_use_the_clusters_own_differences():
    first, second = (
        [np.array([1, 1, 0]), np.array([1, 1]), np.array([1.0])],
        [np.array([0, 0]), np.array([1, 0]), np.array([0])],
    )
    found = clustered.paired_risk_difference(first, second)
    differences = [2 / 3, 0.5, 1.0]
    assert found == pytest.approx(
        (np.mean(differences), *stats.ttest_1samp(differences, 0).confidence_interval())
    )
    single = clustered.paired_risk_difference(singles([1, 1, 0, 1]), singles([0, 1, 0, 0]))
    assert single.value == pytest.approx(0.5) and single.low < 0.5 < single.high


def test_hedges_g_is_cohens_d_without_its_bias():
    one, two = np.array([3.0, 4, 5, 6, 7]), np.array([1.0, 2, 3, 4, 5])
    # Hedges' approximation of his factor.
    expected = 2 / math.sqrt(2.5) * (1 - 3 / (4 * 8 - 1))
    assert clustered.standardised_difference(one, two) == pytest.approx(expected, rel=1e-3)
    shifted = two + [1.0, 2, 3, 2, 1]
    pairs = clustered.standardised_difference(shifted, two, is_paired=True)
    expected = 1.8 / math.sqrt(0.7) * (1 - 3 / (4 * 4 - 1))
    assert pairs == pytest.approx(expected, rel=5e-3)
    assert math.isnan(clustered.standardised_difference(np.ones(2), np.ones(2)))
