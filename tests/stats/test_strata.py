"""Rates over strata, against hand computation and simulated coverage."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.stats.intervals import wilson
from ravenjax.stats.strata import neyman, stratified


def test_hand_computed_rate_and_error():
    # rates 0.5 and 0.1, weights 1/4 and 3/4: 0.125 + 0.075; variance 1/16 * 0.25/20 + 9/16 * 0.09/50
    found = stratified([10, 5], [20, 50], [1, 3])
    assert found.value == pytest.approx(0.2) and found.n == 70
    assert found.error == pytest.approx(np.sqrt(0.25 / 20 / 16 + 9 / 16 * 0.09 / 50))
    assert found.low < 0.2 < found.high


def test_one_stratum_is_a_wilson_rate():
    assert stratified([3], [40], [7])[:3] == pytest.approx(wilson(3, 40)[2:])


def test_a_stratum_of_no_weight_does_not_count():
    assert stratified([3, 9, 0], [40, 9, 0], [1, 0, 0]) == stratified([3], [40], [1])


@pytest.mark.parametrize("p", [[0.3, 0.1, 0.02], [0.002, 0.001, 0.01]])
def test_coverage(p):
    weight, n = np.array([0.2, 0.5, 0.3]), np.array([50, 80, 200])
    truth = weight @ p
    found = [stratified(k, n, weight) for k in np.random.default_rng(0).binomial(n, p, (1500, 3))]
    inside = np.mean([rate.low <= truth <= rate.high for rate in found])
    assert inside > 0.93  # 0.95 less 3.5 standard errors
    if min(p) > 0.01:  # where cases are so rare that most strata see none, it covers more
        assert inside < 0.97 and np.std([rate.value for rate in found]) == pytest.approx(
            np.mean([rate.error for rate in found]), rel=0.1
        )


def test_neyman_beats_every_neighbour():
    weight, rate = np.array([0.5, 0.3, 0.2]), np.array([0.5, 0.1, 0.02])
    runs = neyman(600, weight, rate)
    assert runs.sum() == 600

    def variance(n):
        return np.sum(weight**2 * rate * (1 - rate) / n)

    for i in range(3):
        for j in range(3):
            moved = runs + np.eye(3, dtype=int)[i] * 8 - np.eye(3, dtype=int)[j] * 8
            assert variance(runs) <= variance(moved)


def test_neyman_never_starves_a_stratum():
    runs = neyman(100, [1, 1, 1], [0.5, 0.0, 1e-6], least=10)
    assert runs.tolist() == [80, 10, 10]
    assert neyman(7, [1, 1, 1], [0, 0, 0]).tolist() == [3, 2, 2]


@pytest.mark.parametrize(
    ("k", "n", "weight", "message"),
    [
        ([1], [2, 3], [1, 1], "length"),
        ([1, 0], [2, 0], [1, 1], "no run"),
        ([1, 0], [2, 1], [1, -1], "weights"),
        ([3, 0], [2, 1], [1, 1], "0 <= k <= n"),
    ],
)
def test_bad_strata_are_refused(k, n, weight, message):
    with pytest.raises(ValueError, match=message):
        stratified(k, n, weight)


def test_too_few_runs_to_allocate():
    with pytest.raises(ValueError, match="fewer than 2"):
        neyman(5, [1, 1, 1], [0.1, 0.1, 0.1], least=2)
