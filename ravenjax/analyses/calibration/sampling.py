"""Sampling for what `fit` finds by slopes: how many replays it takes to come as near, and whether
it finds better.

Costs are those of the fit, in its last weights: squared residuals and beliefs, -2 log posterior but
for a constant. A search has come near where its best cost is above the fit's by no more than there
are unknowns, which is what a draw from the posterior has on average.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from ravenjax.analyses.calibration import fit as fitting
from ravenjax.analyses.calibration.fit import Fit, Predictor

Cost = Callable[[np.ndarray], np.ndarray]
"""steps [K, k] (spreads) -> costs [K]."""
ELITE = 0.25  # of a generation, those that the next is drawn around
GENERATION = 16  # draws per unknown, so that the best of them tell a covariance
CHAINS = 3  # per unknown; with fewer they do not span the unknowns
LEAST_SPREAD = 1e-3  # spreads; below it a generation would be one robot


class ReplayEffort(NamedTuple):
    """What it took."""

    replays: int
    seconds: float

    def __add__(self, other: ReplayEffort) -> ReplayEffort:  # type: ignore[override]
        return ReplayEffort(self.replays + other.replays, self.seconds + other.seconds)


class Search(NamedTuple):
    """One way to search."""

    name: str
    near: ReplayEffort | None  # until it came near the fit; None: it did not
    whole: ReplayEffort
    excess: float  # best cost above the fit's; below 0: it found better


class Counter:
    """A predictor that counts its replays and their time."""

    def __init__(self, predict: Predictor) -> None:
        self._predict, self.replays, self.seconds = predict, 0, 0.0

    def __call__(self, steps: np.ndarray) -> np.ndarray:
        """Predictions of `steps` [K, k]."""
        start = time.perf_counter()
        joints = self._predict(steps)
        self.replays, self.seconds = (
            self.replays + len(steps),
            self.seconds + time.perf_counter() - start,
        )
        return joints

    @property
    def effort(self) -> ReplayEffort:
        """So far."""
        return ReplayEffort(self.replays, self.seconds)


def searches(
    predict: Predictor, measured: np.ndarray, best: Fit, replays: int, seed: int = 0
) -> list[Search]:
    """Every way with `replays` each. predict, measured [n, 7], best: as of the fit."""
    rows = fitting.rows(len(best.steps))
    target = fitting.costs(
        best, measured, fitting.padded(predict, best.steps[None], rows), best.steps[None]
    )[0]
    ways = {
        "draws from the beliefs": beliefs,
        "cross-entropy": cross_entropy,
        "Markov chains": chains,
    }
    results = []
    for name, way in ways.items():
        counter = Counter(predict)
        lowest, near = np.inf, None

        def cost(steps: np.ndarray, counter: Counter = counter) -> np.ndarray:
            return fitting.costs(best, measured, fitting.padded(counter, steps, rows), steps)

        for costs in way(cost, len(best.steps), rows, np.random.default_rng(seed)):
            lowest = min(lowest, float(np.min(costs)))
            near = counter.effort if near is None and lowest <= target + len(best.steps) else near
            if counter.replays >= replays:
                break
        results.append(Search(name, near, counter.effort, float(lowest - target)))
    return results


def beliefs(cost: Cost, unknowns: int, rows: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Importance sampling from the beliefs before the log: costs [rows] of round after round."""
    while True:
        yield cost(rng.standard_normal((rows, unknowns)))


def cross_entropy(
    cost: Cost, unknowns: int, rows: int, rng: np.random.Generator
) -> Iterator[np.ndarray]:
    """Adaptive importance sampling: each generation from the normal distribution of the last one's
    best.

    Rubinstein, Kroese, The Cross-Entropy Method, 2004.
    """
    rounds = -(-GENERATION * unknowns // rows)
    mean, covariance = np.zeros(unknowns), np.eye(unknowns)
    while True:
        draws = rng.multivariate_normal(mean, covariance, rounds * rows)
        costs = []
        for part in np.split(draws, rounds):
            costs.append(cost(part))
            yield costs[-1]
        best = draws[np.argsort(np.concatenate(costs))[: int(ELITE * len(draws))]]
        mean = best.mean(axis=0)
        covariance = np.cov(best.T).reshape(unknowns, unknowns) + LEAST_SPREAD**2 * np.eye(unknowns)


def chains(cost: Cost, unknowns: int, rows: int, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Metropolis chains side by side, each stepping along the difference of two others.

    ter Braak, Statistics and Computing 16, 2006 (differential evolution Markov chain), 2.38 /
    sqrt(2 k).
    """
    number = rows * -(-CHAINS * unknowns // rows)
    state = rng.standard_normal((number, unknowns))
    costs = cost(state)
    yield costs
    while True:
        others = np.array(
            [
                rng.choice(np.delete(np.arange(number), one), 2, replace=False)
                for one in range(number)
            ]
        )
        jump = 2.38 / np.sqrt(2.0 * unknowns) * (state[others[:, 0]] - state[others[:, 1]])
        proposal = state + jump + rng.normal(0.0, LEAST_SPREAD, state.shape)
        new = cost(proposal)
        better = np.log(rng.random(number)) < (costs - new) / 2.0
        state, costs = np.where(better[:, None], proposal, state), np.where(better, new, costs)
        yield costs
