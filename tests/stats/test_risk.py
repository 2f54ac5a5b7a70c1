"""Two independent rates, against published values, symmetry and exact coverage."""

import numpy as np
import pytest
from scipy.stats import binom

from ravenjax.stats.intervals import rate_difference


def test_published_difference():
    # Newcombe 1998, table II: 56/70 - 48/80, method 10: 0.0524 to 0.3339
    assert rate_difference(56, 70, 48, 80) == pytest.approx((0.2, 0.0524, 0.3339), abs=5e-5)


def test_coverage_over_all_outcomes():
    """Chance that the interval holds the truth, a sum over all pairs of outcomes."""
    n1, n2 = 30, 40
    for p1, p2 in ((0.1, 0.4), (0.5, 0.5), (0.05, 0.05)):
        chance = np.outer(binom.pmf(range(n1 + 1), n1, p1), binom.pmf(range(n2 + 1), n2, p2))
        held = 0.0
        for k1, k2 in np.argwhere(chance > 1e-4):
            difference = rate_difference(k1, n1, k2, n2)
            held += chance[k1, k2] * (difference.low <= p1 - p2 <= difference.high)
        assert 0.935 < held / chance[chance > 1e-4].sum() < 0.995, (p1, p2, held)
