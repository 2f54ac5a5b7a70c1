"""Pairs of runs, against hand computation and simulated coverage."""

import numpy as np
import pytest
from scipy.stats import norm

from ravenjax.stats.comparison.paired import mcnemar_test, rate_difference


def pairs(both, first, second, none):
    one = np.repeat([1, 1, 0, 0], [both, first, second, none]).astype(bool)
    two = np.repeat([1, 0, 1, 0], [both, first, second, none]).astype(bool)
    return one, two


def test_mcnemar_by_hand():
    # 8 discordant pairs, 1 against 7: p = 2 (C(8,0) + C(8,1)) / 2^8 = 18 / 256
    assert mcnemar_test(*pairs(20, 1, 7, 30)) == pytest.approx(18 / 256)
    assert mcnemar_test(*pairs(5, 0, 0, 5)) == 1.0


def test_difference_by_hand():
    # 5 and 1 discordant of 20 pairs; Bonett and Price add 1 to each and 2 to n: 6/22 and 2/22
    d, variance = 4 / 22, (8 / 22 - (4 / 22) ** 2) / 22
    half = norm.isf(0.025) * np.sqrt(variance)
    assert rate_difference(*pairs(4, 5, 1, 10)) == pytest.approx((4 / 20, d - half, d + half))


def test_difference_uses_the_pairs():
    narrow, wide = rate_difference(*pairs(45, 5, 0, 50)), rate_difference(*pairs(0, 50, 45, 5))
    assert narrow.value == wide.value == 0.05
    assert narrow.high - narrow.low < 0.4 * (wide.high - wide.low)


@pytest.mark.parametrize(
    "chances", [(0.3, 0.1, 0.05, 0.55), (0.02, 0.02, 0.0, 0.96), (0.4, 0.2, 0.2, 0.2)]
)
def test_coverage_of_the_rate_difference(chances):
    truth = chances[1] - chances[2]
    found = [
        rate_difference(*pairs(*n)) for n in np.random.default_rng(0).multinomial(80, chances, 2000)
    ]
    inside = np.mean([one.low <= truth <= one.high for one in found])
    assert inside > 0.95 - 3.5 * np.sqrt(0.95 * 0.05 / 2000)
    assert inside < 0.97 or min(chances) == 0.0  # nearly no discordant pair: it covers more


def test_no_pairs_have_no_difference():
    assert np.isnan(rate_difference([], [])).all()


def test_pairs_of_other_lengths_are_refused():
    with pytest.raises(ValueError, match="one shape"):
        mcnemar_test([1, 0], [1])
