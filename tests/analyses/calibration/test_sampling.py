"""Sampling beside the fit, on predictions with a closed form."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.analyses.calibration import fit as fitting
from ravenjax.analyses.calibration import sampling

ROWS, UNKNOWNS, BUDGET = 200, 3, 6000
TIME = np.linspace(0.0, 1.0, ROWS)
TRUTH = np.array([0.8, -0.5, 0.3])


def predictor(steps: np.ndarray) -> np.ndarray:
    """Each joint a decay of its own rate; the others do not move."""
    joints = np.zeros((len(steps), ROWS, 7))
    joints[:, :, :UNKNOWNS] = np.exp(-np.exp(steps[:, None, :]) * TIME[:, None])
    return joints


@pytest.fixture(scope="module")
def measured() -> np.ndarray:
    joints = predictor(TRUTH[None])[0] + np.random.default_rng(5).normal(0.0, 0.01, (ROWS, 7))
    joints[:, UNKNOWNS:] = np.nan
    return joints


@pytest.fixture(scope="module")
def results(measured) -> tuple[int, dict[str, sampling.Search]]:
    counter = sampling.Counter(predictor)
    best = fitting.fit(counter, measured, UNKNOWNS)
    return counter.replays, {
        one.name: one for one in sampling.searches(predictor, measured, best, BUDGET)
    }


def test_slopes_need_fewer_replays_than_any_sampling(results) -> None:
    replays, searches = results
    for name in ("cross-entropy", "Markov chains"):
        near = searches[name].near
        assert near is not None and near.replays > 2 * replays
    assert searches["draws from the beliefs"].near is None


def test_none_finds_better_than_the_fit_by_much(results) -> None:
    _, searches = results
    assert all(one.excess > -0.5 for one in searches.values())
    assert searches["cross-entropy"].excess < 1.0 < searches["draws from the beliefs"].excess
    assert all(one.whole.replays >= BUDGET for one in searches.values())


def test_chains_sample_the_posterior() -> None:
    """Of a normal cost, whose mean and covariance are known."""
    mean, deviation = np.array([0.5, -1.0]), np.array([0.2, 0.05])
    visited = []

    def cost(steps: np.ndarray) -> np.ndarray:
        visited.append(steps)
        return (((steps - mean) / deviation) ** 2).sum(axis=1)

    rounds = sampling.chains(cost, 2, 8, np.random.default_rng(1))
    costs = np.array([next(rounds) for _ in range(2000)])[500:]
    assert costs.mean() == pytest.approx(2.0, rel=0.1)  # chi-squared with two degrees of freedom
    assert np.quantile(costs, 0.9) == pytest.approx(4.605, rel=0.1)


def test_a_counter_counts() -> None:
    counter = sampling.Counter(predictor)
    counter(np.zeros((3, UNKNOWNS)))
    counter(np.zeros((2, UNKNOWNS)))
    assert counter.effort.replays == 5 and counter.effort.seconds > 0.0
