"""Study that simulates the whole hazard library: outcome classes of every hazard, and severity by
category of adverse event reports.

The runs of a hazard have chosen values and times. A rate is therefore the share of these runs, not
a frequency of occurrence, and has no interval. A pool is a set of hazards that count equally. The
uncertainty of its mean depends on its number of hazards, so its interval resamples hazards.
"""

import math
import tomllib
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from ravenjax.hazards import library, naming
from ravenjax.report import wording
from ravenjax.stats import units
from ravenjax.stats.intervals import Estimate
from ravenjax.store import folder
from studies import study
from studies.hazards import classes, safecomp45
from studies.hazards.safecomp45 import NOT_SIMULATED, HazardOutcome
from studies.study import Cell, Line, Published, StudyEstimate, own_line

NAME, BASELINE, EVERY_CYCLE = "hazard_library", "library", "every_cycle"
DOCUMENTED = ("id", "layer", "title", "source", "expected", "documented_only")


class Pool(NamedTuple):
    """Hazards that belong together."""

    name: str
    meaning: str
    hazards: tuple[str, ...]  # ids
    weight: float = 1.0  # against other pools


class PoolRisk(NamedTuple):
    """The severity of the runs of a pool's hazards."""

    pool: Pool  # with only those of its hazards that have runs
    mean: float = math.nan  # mean severity; NaN, without rates: no hazard has runs
    injury: Estimate | None = None
    silent: Estimate | None = None


def report_pools() -> list[Pool]:
    """Return the categories of adverse event reports with the simulated hazards of each."""
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


def compare(context: study.Context) -> study.Findings:
    """Compare the outcomes of all hazards, and return their severities by category of reports."""
    runnable = [row for row in library.all_hazards() if row.runnable]
    frames = [folder.read_all(context.folders[name]) for name in (BASELINE, EVERY_CYCLE)]
    outcomes, others = (safecomp45.hazard_outcomes(frame, runnable) for frame in frames)
    unrun = [
        [getattr(row, field) for field in DOCUMENTED]
        for row in library.all_hazards()
        if not row.runnable
    ]
    found, pools = counts(frames[0]), report_pools()
    meaning = "all simulated categories by their shares; a hazard in two categories counts in both"
    risks = [*(by_pool(found, pool) for pool in pools), together(found, pools, "all", meaning)]
    return study.findings(
        NAME,
        _lines(outcomes, others),
        {"rows": map(_row, outcomes), "documented": unrun, "risk": map(_pool_row, risks)},
    )


def _row(one: HazardOutcome) -> tuple[Cell, ...]:
    row = one.hazard
    return (
        *(row.id, row.layer, row.title, row.source, one.runs, one.activated),
        *(", ".join(row.expected_class), one.said, one.verdict, one.reason),
    )


def _pool_row(one: PoolRisk) -> tuple[Cell, ...]:
    pool = one.pool
    return (
        *(pool.name, pool.meaning, ", ".join(dict.fromkeys(pool.hazards)) or NOT_SIMULATED),
        wording.format_percent(pool.weight),
        "" if math.isnan(one.mean) else round(one.mean, 2),
        *map(_percent, (one.injury, one.silent)),
    )


def _percent(mean: Estimate | None) -> str:
    if mean is None:
        return ""
    value, low, high = map(wording.format_percent, mean)
    return value if math.isnan(mean.low) else f"{value} ({low} to {high})"


def _lines(found: Sequence[HazardOutcome], others: Sequence[HazardOutcome]) -> Iterator[Line]:
    counts = {
        "hazards that were simulated": sum(one.runs > 0 for one in found),
        "hazards activated in at least one run": sum(one.activated > 0 for one in found),
        "hazards activated in every run": sum(0 < one.runs == one.activated for one in found),
    }
    for quantity, count in counts.items():
        value = StudyEstimate(count, n=len(found), of="hazards that can be simulated")
        yield own_line(quantity, "", value)
    reason, published = (
        "the published values were drawn; in this study all values and hazards count equally",
        Published(NAME),
    )
    for packets, part in {"": found, ", one packet per control cycle": others}.items():
        for key, row in published.numbers.items():
            mine = [one for one in part if one.valid and one.hazard.id in row["rows"]]
            predicted = _manifest(mine, jumps=key == "put_usb_jumps") if mine else None
            what = f"{row['what']}{packets}"
            yield Line(what, "%", published.estimate(key), predicted, reason=reason)


def _manifest(rows: Sequence[HazardOutcome], jumps: bool) -> StudyEstimate:
    """Return the share of activated runs with a jump, or with an effect. Hazards count equally."""
    runs, ids = np.array([one.valid for one in rows]), [one.hazard.id for one in rows]
    hits = [one.counts["jump"] if jumps else one.valid - one.without_effect for one in rows]
    rate = mean_over(hits / runs, ids, np.ones(len(rows)))
    percent = (100 * end for end in rate)
    return StudyEstimate(*percent, int(runs.sum()), f"runs (hazard ids: {', '.join(ids)})")


STUDY = study.study(NAME, study.read_variants(NAME), compare)
