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
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from ravenjax.hazards import naming, severity
from ravenjax.outcomes.verdict import LIMIT_MM
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import Section
from ravenjax.stats.bootstrap import units
from ravenjax.stats.intervals import Estimate, Rate, share

Counts = Mapping[str, np.ndarray]
"""Hazard id -> valid runs of each severity, int [6]."""


@dataclass(frozen=True)
class HazardRisk:
    """How bad the runs of one hazard were."""

    hazard: str  # its id
    counts: tuple[int, ...]  # valid runs of severity 0 .. 5
    # probability times severity, summed; severities are ordinal, so it ranks and does not measure
    mean: float
    injury: Rate  # injury-capable motion
    silent: Rate  # the same without any alarm


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


def counted(runs: Runs) -> dict[str, np.ndarray]:
    """`counts` of every run of a table, a batch of rows at a time."""
    manifest = runs.manifest
    cue = manifest.verdict_cue if manifest.cues else None
    alarms = [] if cue is None else [f"cue{cue}_first_ms", f"golden_cue{cue}_first_ms"]
    slots = [name for name in runs.names if name.startswith("fault")]
    needed = dict.fromkeys([*severity.COLUMNS, "group", *alarms, *slots])
    result: dict[str, np.ndarray] = {}
    for frame in runs.batches(list(needed)):
        for name, number in counts(frame, cue, manifest.limit_mm).items():
            result[name] = result.get(name, 0) + number
    return result


def by_hazard(found: Counts) -> list[HazardRisk]:
    """One row a hazard with runs, the worst first: by mean severity, then by id."""
    rows = [
        HazardRisk(
            name,
            tuple(int(n) for n in number),
            _mean(number),
            share(int(number[severity.INJURY :].sum()), int(number.sum())),
            share(int(number[-1]), int(number.sum())),
        )
        for name, number in found.items()
        if number.sum()
    ]
    return sorted(rows, key=lambda row: (-row.mean, row.hazard))


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


def _content(runs: Runs, _: Path) -> dict[str, Any] | None:
    if not any(naming.hazards_of(group) for group in runs.groups()):
        return None
    risks = by_hazard(counted(runs))
    if not risks:
        return None
    grades = [{f"severity_{grade}": n for grade, n in enumerate(one.counts)} for one in risks]
    return {
        "risks": risks,
        "risk_rows": [
            {"hazard": one.hazard, "mean": one.mean, "injury": one.injury, "silent": one.silent}
            | grade
            for one, grade in zip(risks, grades, strict=True)
        ],
        "severities": severity.SCALE,
        "depth_mm": severity.DEPTH_MM,
    }


SECTIONS = (Section("risk", "Risk", 90, _content),)
