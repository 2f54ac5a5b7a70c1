"""Rates over strata, against hand computation and simulated coverage."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.stats.intervals import wilson_interval
from ravenjax.stats.sequential import allocate_runs, stratified_rate


def test_hand_computed_rate():
    # rates 0.5 and 0.1, weights 1/4 and 3/4: 0.125 + 0.075
    found = stratified_rate([10, 5], [20, 50], [1, 3])
    assert found.value == pytest.approx(0.2) and found.low < 0.2 < found.high


def test_one_stratum_is_a_wilson_rate():
    assert stratified_rate([3], [40], [7]) == pytest.approx(wilson_interval(3, 40)[2:])


@pytest.mark.parametrize("p", [[0.3, 0.1, 0.02], [0.002, 0.001, 0.01]])
def test_coverage(p):
    weight, n = np.array([0.2, 0.5, 0.3]), np.array([50, 80, 200])
    truth = weight @ p
    found = [
        stratified_rate(k, n, weight) for k in np.random.default_rng(0).binomial(n, p, (1500, 3))
    ]
    inside = np.mean([rate.low <= truth <= rate.high for rate in found])
    assert inside > 0.93  # 0.95 less 3.5 standard errors
    # where cases are so rare that most strata see none, it covers more
    assert inside < 0.97 or min(p) < 0.01


STRATA = st.lists(
    st.tuples(st.sampled_from([0.0, 0.3, 1.0, 2.5]), st.integers(0, 4), st.integers(0, 5)),
    min_size=1,
    max_size=4,
)


@given(STRATA, st.integers(0, 30))
def test_allocation_keeps_its_bounds_and_is_the_best_there_is(strata, total):
    """Against every other allocation within the bounds: none has a smaller sum of spread^2 /
    runs.
    """
    spread, low, more = (np.array(column) for column in zip(*strata, strict=True))
    high = low + more
    runs = allocate_runs(total, spread, low, high)
    assert ((low <= runs) & (runs <= high)).all() and runs.sum() == np.clip(
        total, low.sum(), high.sum()
    )

    def variance(n):
        return np.where(spread > 0, spread**2 / np.maximum(n, 1e-9), 0.0).sum()

    near = [
        runs + np.eye(len(runs), dtype=int)[i] - np.eye(len(runs), dtype=int)[j]
        for i in range(len(runs))
        for j in range(len(runs))
    ]
    within = [n for n in near if ((low <= n) & (n <= high)).all()]
    exact = (
        allocate_runs(total * 1000, spread, low * 1000, high * 1000) / 1000
    )  # where whole numbers hardly round
    assert all(variance(exact) <= variance(exact + (n - runs) / 1000) * (1 + 1e-6) for n in within)


def test_what_has_no_spread_takes_what_is_left_over():
    assert allocate_runs(20, [1, 0, 0], [0, 0, 0], [10, 3, 50]).tolist() == [10, 3, 7]
    assert allocate_runs(10, [1, 0], [0, 2], [100, 100]).tolist() == [8, 2]
