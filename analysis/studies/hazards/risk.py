"""Computes the severity of the runs of each hazard, of pools of hazards, and of weighted pools.

The runs of a hazard have chosen values and times. A rate is therefore the share of these runs, not
a frequency of occurrence, and has no interval. All hazards of a pool count equally. The uncertainty
of a pool's mean depends on its number of hazards, so its interval resamples hazards.
"""

import math
import tomllib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.hazards import library, naming
from ravenjax.stats.bootstrap import units
from ravenjax.stats.intervals import Estimate
from studies.hazards import classes


class Pool(NamedTuple):
    """Hazards that belong together."""

    name: str
    meaning: str
    hazards: tuple[str, ...]  # ids
    weight: float = 1.0  # against other pools


class PoolRisk(NamedTuple):
    """The severity of the runs of a pool's hazards."""

    pool: Pool  # with only those of its hazards that have runs
    mean: float = math.nan  # as of one hazard; NaN: no hazard has runs, and no rates
    injury: Estimate | None = None
    silent: Estimate | None = None


def report_pools() -> list[Pool]:
    """Return the categories of adverse event reports with the runnable rows that represent them."""
    reports = tomllib.loads((library.DATA / "maude.toml").read_text(encoding="utf-8"))
    pools = []
    for category in reports["category"]:
        ids, hazards, scenarios = (
            set(category.get(key, ())) for key in ("ids", "hazards", "scenarios")
        )
        rows = tuple(
            row.id
            for row in library.all_hazards()
            if row.runnable
            and (row.id in ids or hazards & set(row.hazards) or scenarios & set(row.scenarios))
        )
        pools.append(Pool(category["name"], category["source"], rows, category["share"]))
    return pools


def counts(frame: pd.DataFrame) -> pd.DataFrame:
    """Return the number of valid runs by hazard id (rows) and severity (columns 0 to 5)."""
    hazard = frame["group"].astype(str).map(naming.hazards_of).explode()
    severity = classes.rate_severity(frame).loc[hazard.index].to_numpy()
    return pd.crosstab(hazard.to_numpy(), severity).reindex(
        columns=range(len(classes.SEVERITIES)), fill_value=0
    )


def by_pool(found: pd.DataFrame, pool: Pool) -> PoolRisk:
    """Return the risk of a pool's hazards, each counting equally. `found`: as `counts` returns."""
    one = together(found, [pool], pool.name, pool.meaning)
    return one._replace(pool=one.pool._replace(weight=pool.weight))


def together(found: pd.DataFrame, pools: Sequence[Pool], name: str, meaning: str) -> PoolRisk:
    """Return the risk of all pools by their weights, without pools that have no run."""
    ids, weights, total = [], [], 0.0
    for pool in pools:
        if run := [one for one in pool.hazards if one in found.index]:
            ids += run
            weights += [pool.weight / len(run)] * len(run)
            total += pool.weight
    whole, weight = Pool(name, meaning, tuple(ids), total), np.array(weights)
    if not ids:
        return PoolRisk(whole)
    numbers = found.loc[ids].to_numpy()
    share = numbers / numbers.sum(axis=1, keepdims=True)
    injury = numbers[:, classes.INJURY :].sum(axis=1) / numbers.sum(axis=1)
    return PoolRisk(
        whole,
        float(np.average(share @ np.arange(share.shape[1]), weights=weight)),
        mean_over(injury, ids, weight),
        mean_over(share[:, -1], ids, weight),
    )


def mean_over(shares: np.ndarray, hazard: Sequence[str], weight: np.ndarray) -> Estimate:
    """Return the weighted mean of shares [n] with its interval over distinct hazards."""
    return units.ratio_band(weight * shares, weight, units.group_units(np.array(hazard, object)))
