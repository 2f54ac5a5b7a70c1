"""How bad the runs of each hazard were, of pools of hazards, and of pools weighted against each
other.

A hazard's runs are a design over values and times that somebody chose, so a rate says what share of
*these* runs did it, not how often it happens, and has no interval. Hazards of a pool count alike;
how sure a pool's mean is rests on how many hazards it has, so that its interval resamples hazards.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ravenjax.hazards import naming, severity
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.stats.bootstrap import units
from ravenjax.stats.intervals import Estimate

Counts = Mapping[str, np.ndarray]
"""Hazard id -> valid runs of each severity, int [6]."""


@dataclass(frozen=True)
class Pool:
    """Hazards that belong together."""

    name: str
    meaning: str
    hazards: tuple[str, ...]  # ids
    weight: float = math.nan  # against other pools; NaN: none


@dataclass(frozen=True)
class PoolRisk:
    """How bad the runs of a pool's hazards were."""

    pool: Pool  # with those of its hazards that have runs
    mean: float  # as of one hazard; NaN: no hazard has runs, and no rates
    injury: Estimate | None
    silent: Estimate | None


def counts(
    frame: pd.DataFrame, cue: int | None = 0, limit_mm: float = LIMIT_MM
) -> dict[str, np.ndarray]:
    """Hazard id -> valid runs of each severity, int [6], of the groups whose names begin with
    hazards' ids.

    A group that stands for several hazards counts for each. cue, limit_mm: as in
    `severity.severity`.
    """
    result: dict[str, np.ndarray] = {}
    grades = severity.severity(frame, cue, limit_mm)
    for group, part in grades.groupby(frame["group"].astype(str)):
        number = np.bincount(part.dropna().to_numpy(int), minlength=len(severity.SCALE))
        for name in naming.hazards_of(str(group)):
            result[name] = result.get(name, 0) + number
    return result


def by_pool(found: Counts, pool: Pool) -> PoolRisk:
    """The hazards of a pool, each counting alike."""
    ids = _run(found, pool)
    return _pooled(found, Pool(pool.name, pool.meaning, ids, pool.weight), [1.0] * len(ids))


def together(found: Counts, pools: Sequence[Pool], name: str, meaning: str) -> PoolRisk:
    """Pools against each other by their weights, those without a run left out; a hazard of two
    counts in both.
    """
    run = [(pool, ids) for pool in pools if (ids := _run(found, pool))]
    ids = tuple(one for _, own in run for one in own)
    weights = [pool.weight / len(own) for pool, own in run for _ in own]
    return _pooled(found, Pool(name, meaning, ids, sum(pool.weight for pool, _ in run)), weights)


def _run(found: Counts, pool: Pool) -> tuple[str, ...]:
    return tuple(name for name in pool.hazards if name in found and found[name].sum())


def _pooled(found: Counts, pool: Pool, weights: Sequence[float]) -> PoolRisk:
    if not pool.hazards:
        return PoolRisk(pool, math.nan, None, None)
    numbers = np.array([found[name] for name in pool.hazards])
    runs, weight = numbers.sum(axis=1), np.array(weights, float)
    return PoolRisk(
        pool,
        float(weight @ [_mean(number) for number in numbers] / weight.sum()),
        mean_over(numbers[:, severity.INJURY :].sum(axis=1) / runs, pool.hazards, weight),
        mean_over(numbers[:, -1] / runs, pool.hazards, weight),
    )


def mean_over(shares: np.ndarray, hazard: Sequence[str], weight: np.ndarray) -> Estimate:
    """Weighted mean of shares [n] of hazards with its interval over hazards (`units.ratio`); one
    that stands twice is one unit."""
    band = units.ratio(weight * shares, weight, units.units(np.array(hazard, object)))
    return Estimate(float(band.value), band.low, band.high)


def _mean(number: np.ndarray) -> float:
    return float(number @ np.arange(len(number)) / number.sum())
