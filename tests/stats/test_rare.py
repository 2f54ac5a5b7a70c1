"""Rare events of known probability: plain Monte Carlo and subset simulation against it and
against each other.
"""

import sys

import numpy as np
import pytest
from scipy.special import ndtri
from scipy.stats import norm

from ravenjax.stats.rare import monte_carlo, subset_simulation

D = 5


def plane(probability):
    """A limit state in D normal inputs that fails with just this probability."""
    distance = norm.isf(probability)
    return lambda u: distance - ndtri(u).sum(axis=1) / np.sqrt(D)


def corners(probability):
    """Two separate regions of failure, along one uniform input each way."""
    return lambda u: np.minimum(u[:, 0], 1 - u[:, 0]) - probability / 2


def test_plain_monte_carlo():
    found = monte_carlo(plane(1e-2), D, 40_000, seed=1)
    assert found.low < 1e-2 < found.high and found.cov == pytest.approx(
        np.sqrt(0.99 / 400), rel=0.15
    )
    assert found.runs == 40_000
    never = monte_carlo(lambda u: u[:, 0] + 1, 1, 1000)
    assert (
        (never.probability, never.low) == (0, 0)
        and never.high == pytest.approx(3.69e-3, rel=0.01)
        and np.isnan(never.cov)
    )


@pytest.mark.slow
@pytest.mark.parametrize("limit", [plane, corners])
@pytest.mark.parametrize("probability", [1e-2, 1e-3, 1e-4])
def test_subset_against_the_known_probability(limit, probability):
    g = limit(probability)
    found = [subset_simulation(g, D, seed=seed) for seed in range(40)]
    value = np.array([one.probability for one in found])
    spread = value.std() / probability
    assert value.mean() == pytest.approx(
        probability, rel=3.5 * spread / np.sqrt(40) + 0.05
    )  # biased by O(1 / per_level)
    cov = np.mean([one.cov for one in found])
    assert (
        0.6 * spread < cov < 1.4 * spread
    )  # Au and Beck's neglects what levels share: somewhat small
    inside = np.mean([one.low <= probability <= one.high for one in found])
    assert inside > 0.8
    assert (
        max(one.runs for one in found) <= 6000 < 100 / probability
    )  # plain Monte Carlo of 10 % cov


def test_subset_against_plain_monte_carlo():
    g = plane(3e-3)
    plain, steps = monte_carlo(g, D, 100_000, seed=2), subset_simulation(g, D, 2000, seed=2)
    assert steps.low < plain.high and plain.low < steps.high
    assert steps.levels == tuple(sorted(steps.levels, reverse=True)) and steps.levels[-1] == 0


@pytest.mark.parametrize(
    "g", [lambda u: 1 + u[:, 0], lambda u: np.where(u[:, 0] < 1e-5, -1.0, 1.0)]
)
def test_an_event_out_of_reach_is_bounded_by_the_first_level(g):
    found = subset_simulation(g, 2, 1000)
    assert (found.probability, found.low, found.runs) == (
        0,
        0,
        12_000,
    ) and found.high == pytest.approx(3.68e-3, rel=0.01)


def test_errors_of_the_limit_state_come_through():
    with pytest.raises(ValueError, match="margins are NaN"):
        subset_simulation(lambda u: np.full(len(u), np.nan), 2)
    with pytest.raises(ZeroDivisionError):
        subset_simulation(lambda u: u[:, 0] / (1 // 0), 2)


def test_without_openturns(monkeypatch):
    monkeypatch.setitem(sys.modules, "openturns", None)
    with pytest.raises(ValueError, match=r"ravenjax\[rare\]"):
        subset_simulation(plane(1e-3), D)


@pytest.mark.parametrize("error", [KeyboardInterrupt(), SystemExit(143)])
def test_what_ends_the_program_passes_through_the_library(error):
    def ended(points):
        raise error

    with pytest.raises(type(error)) as raised:
        subset_simulation(ended, 2, 100)
    assert raised.value is error
