"""Computes how severe the runs of each hazard were, of pools of hazards, and of weighted pools.

A hazard's runs are a design over values and times that somebody chose. So a rate is the share of
*these* runs, not a frequency of occurrence, and has no interval. Hazards of a pool count equally.
The certainty of a pool's mean depends on its number of hazards, so its interval resamples hazards.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from ravenjax.hazards import naming
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.stats.bootstrap import units
from ravenjax.stats.intervals import Estimate
from studies.hazards import severity

Counts = Mapping[str, np.ndarray]
"""Maps a hazard id to the number of valid runs of each severity, int [6]."""


@dataclass(frozen=True)
class Pool:
    """Hazards that belong together."""

    name: str
    meaning: str
    hazards: tuple[str, ...]  # ids
    weight: float = math.nan  # against other pools; NaN: no weight


@dataclass(frozen=True)
class PoolRisk:
    """The severity of the runs of a pool's hazards."""

    pool: Pool  # with only those of its hazards that have runs
    mean: float  # as of one hazard; NaN: no hazard has runs, and no rates
    injury: Estimate | None
    silent: Estimate | None


def counts(
    frame: pd.DataFrame, cue: int | None = 0, limit_mm: float = LIMIT_MM
) -> dict[str, np.ndarray]:
    """Return the number of valid runs of each severity by hazard id, int [6], for groups whose
    names begin with hazards' ids.

    A group that represents several hazards counts for each. `cue`, `limit_mm`: as in
    `severity.rate_severity`.
    """
    result: dict[str, np.ndarray] = {}
    grades = severity.rate_severity(frame, cue, limit_mm)
    for group, part in grades.groupby(frame["group"].astype(str)):
        number = np.bincount(part.dropna().to_numpy(int), minlength=len(severity.SCALE))
        for name in naming.hazards_of(str(group)):
            result[name] = result.get(name, 0) + number
    return result


def by_pool(found: Counts, pool: Pool) -> PoolRisk:
    """Return the risk of a pool's hazards, each counting equally."""
    ids = _run(found, pool)
    return _pooled(found, Pool(pool.name, pool.meaning, ids, pool.weight), [1.0] * len(ids))


def together(found: Counts, pools: Sequence[Pool], name: str, meaning: str) -> PoolRisk:
    """Return the risk of all pools by their weights. Pools without a run are left out, and a hazard
    of two pools counts in both.
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
    """Return the weighted mean of shares [n] of hazards with its interval over hazards
    (`units.ratio_band`). A hazard that occurs twice is one unit.
    """
    band = units.ratio_band(weight * shares, weight, units.group_units(np.array(hazard, object)))
    return Estimate(float(band.value), band.low, band.high)


def _mean(number: np.ndarray) -> float:
    return float(number @ np.arange(len(number)) / number.sum())
