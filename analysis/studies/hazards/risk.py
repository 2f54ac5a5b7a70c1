"""Computes the severity of the runs of each hazard, of pools of hazards, and of weighted pools.

The runs of a hazard have chosen values and times. A rate is therefore the share of these runs, not
a frequency of occurrence, and has no interval. All hazards of a pool count equally. The uncertainty
of a pool's mean depends on its number of hazards, so its interval resamples hazards.
"""

import math
import tomllib
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.hazards import library, naming
from ravenjax.stats.bootstrap import units
from ravenjax.stats.intervals import Estimate
from studies.hazards import severity

Counts = Mapping[str, np.ndarray]
"""Maps a hazard id to the number of valid runs of each severity, int [6]."""

CAVEAT = (
    "Weights are shares of adverse event reports (MAUDE 2000 to 2013), not probabilities of a"
    " fault: weighted is how bad the simulated faults of each category are, by how often that"
    " category was reported. Categories overlap; which simulated hazards stand for a category is"
    " ours."
)
"""Belongs beside every number that is computed from shares of reports."""


class Pool(NamedTuple):
    """Hazards that belong together."""

    name: str
    meaning: str
    hazards: tuple[str, ...]  # ids
    weight: float = math.nan  # against other pools; NaN: no weight


class PoolRisk(NamedTuple):
    """The severity of the runs of a pool's hazards."""

    pool: Pool  # with only those of its hazards that have runs
    mean: float = math.nan  # as of one hazard; NaN: no hazard has runs, and no rates
    injury: Estimate | None = None
    silent: Estimate | None = None


def report_pools() -> list[Pool]:
    """Return the categories of adverse event reports (`data/maude.toml`) by their shares.

    A category has the runnable rows of the library that represent it. Without any, it is not
    simulated.
    """

    def represents(row: library.Hazard, category: dict) -> bool:
        hazards, scenarios = category.get("hazards", ()), category.get("scenarios", ())
        return (
            row.id in category.get("ids", ())
            or not set(row.hazards).isdisjoint(hazards)
            or not set(row.scenarios).isdisjoint(scenarios)
        )

    reports = tomllib.loads((library.DATA / "maude.toml").read_text(encoding="utf-8"))
    runnable = [row for row in library.all_hazards() if row.runnable]
    return [
        Pool(
            category["name"],
            category["source"],
            tuple(row.id for row in runnable if represents(row, category)),
            category["share"],
        )
        for category in reports["category"]
    ]


def counts(frame: pd.DataFrame) -> dict[str, np.ndarray]:
    """Return the number of valid runs of each severity by hazard id, int [6], for groups whose
    names begin with hazards' ids.

    A group that represents several hazards counts for each.
    """
    result: dict[str, np.ndarray] = {}
    grades = severity.rate_severity(frame)
    for group, part in grades.groupby(frame["group"].astype(str)):
        number = np.bincount(part.dropna().to_numpy(int), minlength=len(severity.SCALE))
        for name in naming.hazards_of(str(group)):
            result[name] = result.get(name, 0) + number
    return result


def by_pool(found: Counts, pool: Pool) -> PoolRisk:
    """Return the risk of a pool's hazards, each counting equally."""
    ids = _run(found, pool)
    return _pooled(found, pool._replace(hazards=ids), np.ones(len(ids)))


def together(found: Counts, pools: Sequence[Pool], name: str, meaning: str) -> PoolRisk:
    """Return the risk of all pools by their weights. Pools without a run are left out, and a hazard
    of two pools counts in both.
    """
    run = [pool._replace(hazards=ids) for pool in pools if (ids := _run(found, pool))]
    ids = tuple(name for pool in run for name in pool.hazards)
    weights = [pool.weight / len(pool.hazards) for pool in run for _ in pool.hazards]
    whole = Pool(name, meaning, ids, sum(pool.weight for pool in run))
    return _pooled(found, whole, np.array(weights))


def _run(found: Counts, pool: Pool) -> tuple[str, ...]:
    return tuple(name for name in pool.hazards if name in found and found[name].sum())


def _pooled(found: Counts, pool: Pool, weight: np.ndarray) -> PoolRisk:
    if not pool.hazards:
        return PoolRisk(pool)
    numbers = np.array([found[name] for name in pool.hazards])
    share = numbers / numbers.sum(axis=1, keepdims=True)
    injury = numbers[:, severity.INJURY :].sum(axis=1) / numbers.sum(axis=1)
    return PoolRisk(
        pool,
        float(np.average(share @ np.arange(share.shape[1]), weights=weight)),
        mean_over(injury, pool.hazards, weight),
        mean_over(share[:, -1], pool.hazards, weight),
    )


def mean_over(shares: np.ndarray, hazard: Sequence[str], weight: np.ndarray) -> Estimate:
    """Return the weighted mean of shares [n] of hazards with its interval over hazards
    (`units.ratio_band`). A hazard that occurs twice is one unit.
    """
    return units.ratio_band(weight * shares, weight, units.group_units(np.array(hazard, object)))
