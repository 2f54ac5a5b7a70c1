"""Pairs of runs, against hand computation and simulated coverage."""

import numpy as np
import pytest
from scipy.stats import norm

from ravenjax.stats.paired import difference_of_counts, mcnemar_test


def test_mcnemar_by_hand():
    # 8 discordant pairs, 1 against 7: p = 2 (C(8,0) + C(8,1)) / 2^8 = 18 / 256
    assert mcnemar_test(1, 7) == pytest.approx(18 / 256)
    assert mcnemar_test(0, 0) == 1.0


def test_difference_by_hand():
    # 5 and 1 discordant of 20 pairs; Bonett and Price add 1 to each and 2 to n: 6/22 and 2/22
    d, variance = 4 / 22, (8 / 22 - (4 / 22) ** 2) / 22
    half = norm.isf(0.025) * np.sqrt(variance)
    assert difference_of_counts(5, 1, 20) == pytest.approx((4 / 20, d - half, d + half))


def test_difference_uses_the_pairs():
    narrow, wide = difference_of_counts(5, 0, 100), difference_of_counts(50, 45, 100)
    assert narrow.value == wide.value == 0.05
    assert narrow.high - narrow.low < 0.4 * (wide.high - wide.low)


@pytest.mark.parametrize(
    "chances", [(0.3, 0.1, 0.05, 0.55), (0.02, 0.02, 0.0, 0.96), (0.4, 0.2, 0.2, 0.2)]
)
def test_coverage_of_the_rate_difference(chances):
    truth = chances[1] - chances[2]
    found = [
        difference_of_counts(n[1], n[2], 80)
        for n in np.random.default_rng(0).multinomial(80, chances, 2000)
    ]
    inside = np.mean([one.low <= truth <= one.high for one in found])
    assert inside > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / 2000)
    assert inside < 0.97 or min(chances) == 0.0  # nearly no discordant pair: it covers more


def test_no_pairs_have_no_difference():
    assert np.isnan(difference_of_counts(0, 0, 0)).all()
