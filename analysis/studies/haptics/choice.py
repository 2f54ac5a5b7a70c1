"""Which threshold the data would choose, and how sure that choice is.

A threshold costs what it misses and what it says for nothing:

    cost = weight x (share of hazards missed) + false cues an hour

`weight` is false cues an hour: how many of them a missed hazard is worth, times the hazards an
hour. Neither is known, so it is swept. How sure a choice is: kinds of faults and recordings are
drawn anew, and the winners counted. A threshold is named where it wins often enough; else the
motion and the faults at hand do not decide.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ravenjax.stats.bootstrap.units import Units, units

RESAMPLES = 2000
WEIGHTS = (1.0, 10.0, 100.0, 1_000.0, 10_000.0, 100_000.0)
"""In tables."""
SURE = 0.95
"""Share of resamples that a set must win to be named."""


class Counts(NamedTuple):
    """Sums of each unit that is drawn anew: kinds of faults [kinds, sets] and recordings
    [recordings, sets].
    """

    missed: np.ndarray
    hazards: np.ndarray  # [kinds]
    kinds: Units  # each a row, by stratum
    false: np.ndarray
    hours: np.ndarray  # [recordings]


class Winners(NamedTuple):
    """The choice at each weight."""

    weight: np.ndarray  # [weights]
    winner: np.ndarray  # [weights], number of the set
    wins: np.ndarray  # [weights, sets], share of resamples in which it wins; sums to 1
    cost: np.ndarray  # [weights, sets], false cues an hour

    @property
    def sure(self) -> np.ndarray:
        """Whether the choice at each weight is sure enough to be named, bool [weights]."""
        return self.wins[np.arange(len(self.weight)), self.winner] >= SURE


def counts(
    missed: np.ndarray, faults: Units, false: np.ndarray, hours: np.ndarray, recording: np.ndarray
) -> Counts:
    """Sums of missed (bool [hazards, sets]) by kind of fault and of false cues [runs, sets] by
    recording.
    """
    free = units(recording)
    return Counts(
        _by(faults, missed.astype(float)),
        _by(faults, np.ones(len(missed))),
        Units(np.arange(faults.count), faults.stratum),
        _by(free, false),
        _by(free, hours),
    )


def choose(
    found: Counts, weights: np.ndarray, resamples: int = RESAMPLES, seed: int = 0
) -> Winners:
    """The cheapest set at each weight, the highest-numbered of equals (the highest threshold, where
    sets rise).

    Resampling knows nothing of a rate of which no event was seen: such a rate is drawn from what a
    Poisson count of 0 leaves open, an exponential distribution of mean 1 / hours, whose 97.5 % are
    the end of the exact interval. ValueError without hazards or hours.
    """
    if not len(found.hazards) or not found.hours.sum() > 0:
        raise ValueError("a choice needs hazards and motion without a fault")
    weight = np.asarray(weights, float)
    share, rate = (
        found.missed.sum(axis=0) / found.hazards.sum(),
        found.false.sum(axis=0) / found.hours.sum(),
    )
    rng = np.random.default_rng(seed)
    faults = found.kinds.weights(resamples, seed)
    recordings = rng.multinomial(
        len(found.hours), np.full(len(found.hours), 1 / len(found.hours)), resamples
    )
    shares = (faults @ found.missed) / (faults @ found.hazards)[:, None]
    counts, hours = recordings @ found.false, (recordings @ found.hours)[:, None]
    rates = np.where(counts > 0, counts, rng.exponential(size=counts.shape)) / hours
    wins = np.stack(
        [_won(_cheapest(one * shares + rates), found.missed.shape[1]) for one in weight]
    )
    cost = weight[:, None] * share + rate
    return Winners(weight, _cheapest(cost), wins, cost)


def _cheapest(cost: np.ndarray) -> np.ndarray:
    """Last of the cheapest [..., sets]; equal but for rounding is equal."""
    near = cost <= cost.min(axis=-1, keepdims=True) * (1 + 1e-12)
    return cost.shape[-1] - 1 - np.argmax(near[..., ::-1], axis=-1)


def _won(chosen: np.ndarray, sets: int) -> np.ndarray:
    return np.bincount(chosen, minlength=sets) / len(chosen)


def _by(among: Units, values: np.ndarray) -> np.ndarray:
    """Sums [units, ...] of values [n, ...]."""
    total = np.zeros((among.count, *values.shape[1:]))
    np.add.at(total, among.unit, values)
    return total
