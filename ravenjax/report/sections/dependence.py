"""Which conclusions depend on the robot: each rate of the report against each parameter that was
varied.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.hazards.naming import kind_of
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.stats.bootstrap import units
from ravenjax.stats.bootstrap.units import Units
from ravenjax.stats.inputs.association import Dependence
from ravenjax.stats.inputs.clustered import dependences
from ravenjax.stats.intervals import Rate, share
from ravenjax.store.access.query import quoted

LEAST_RUNS = 20
"""Of a conclusion; with fewer, thirds of a parameter hold too few for any statement."""
MOST = 200_000
"""Runs that are looked at one by one; a dependence that these do not show changes a rate by less
than a point.
"""


class Conclusion(NamedTuple):
    """One rate and how it hangs on each varied parameter, the clearest first; Holm over the
    parameters.
    """

    name: str
    rate: Rate  # of all faults; no interval, see `dependences`
    runs: int  # runs that the dependences are of
    units: int  # what intervals and tests count of these: kinds of faults, or robots
    whole: bool  # units are robots, which were drawn whole and met several faults each
    dependences: list[Dependence]


def conclusions(runs: Runs, robots: Sequence[str] = ()) -> list[Conclusion]:
    """The report's rates over one run of each fault, against every parameter that varies among
    them.

    Faults of one kind (a hazard, or a group) resemble each other, and so do faults on one robot:
    intervals and tests count kinds, or robots where these were drawn whole. robots: columns that
    make up such a robot; none: no such draw. Rates are of all such runs; how they depend on a
    parameter is asked of MOST of them, drawn, where there are more.
    """
    condition = "sample AND faulty"
    named = questions(runs)
    hits = ", ".join(
        f"{among} AND {hit} AS hit{i}, {among} AS among{i}"
        for i, (among, hit) in enumerate(named.values())
    )
    query = f'SELECT row, "group"::VARCHAR AS "group", {hits} FROM {FACTS} WHERE {condition}'
    inputs = [quoted(name) for name in runs.names if name.startswith("param:")]
    sample = (
        runs.drawn(", ".join([*inputs, f"{FACTS}.*"]), condition, MOST, of=query)
        if inputs
        else pd.DataFrame()
    )
    names = varied(sample)
    if not names:
        return []
    counts = runs.counts(
        [sql for among, hit in named.values() for sql in (among, f"{among} AND {hit}")],
        where=condition,
    )
    result = []
    for i, name in enumerate(named):
        n, k = counts[2 * i : 2 * i + 2]
        if n >= LEAST_RUNS:
            mine = sample.loc[sample[f"among{i}"]]
            inputs_of = {path.removeprefix("param:"): mine[path].to_numpy(float) for path in names}
            among = _units(mine, robots)
            links = dependences(mine[f"hit{i}"].to_numpy(bool), inputs_of, among)
            result.append(
                Conclusion(name, share(k, n), len(mine), among.count, bool(robots), links)
            )
    return result


def _units(sample: pd.DataFrame, robots: Sequence[str]) -> Units:
    """Robots of some runs, or kinds of their faults."""
    if robots:
        return units.units(
            sample.groupby(list(robots), dropna=False, sort=False).ngroup().to_numpy()
        )
    return units.units(sample["group"].astype(str).map(kind_of).to_numpy())


def questions(runs: Runs) -> dict[str, tuple[str, str]]:
    """What a fault may do: which faults the rate is of, and the condition, of columns of facts.

    The cue's lead is a question only where the definitions do not decide it.
    """
    named = {
        "evades the checks": ("true", "evaded"),
        "makes an unintended motion": ("true", "unintended"),
        "leads to a loss of motion": ("true", "loss"),
        "is told of by a check": ("true", "told"),
    }
    if runs.cue_leads:
        early = "warned_ms >= 0 AND warned_ms < unintended_ms"
        named["has the cue before the unintended motion"] = ("unintended", early)
    return named


def flat(made: list[Conclusion]) -> list[dict[str, Any]]:
    """One row a conclusion and parameter, levels side by side."""
    return [
        {
            "conclusion": one.name,
            "parameter": item.name,
            "n": item.n,
            "units": one.units,
            "p": item.p,
            "adjusted": item.adjusted,
        }
        | {"depends": item.depends, "difference": item.difference}
        | {level.name.replace(" ", "_"): level for level in item.levels}
        for one in made
        for item in one.dependences
    ]


def varied(frame: pd.DataFrame) -> list[str]:
    """Columns of parameters of robot and operation that vary in a table; the cue and the reaction
    to it are choices of the campaign and no uncertainty of the robot."""
    prefixes = ("param:reaction.", "param:haptics.", "param:detectors.")
    return [
        name
        for name in frame
        if name.startswith("param:")
        and not name.startswith(prefixes)
        and np.ptp(_known(frame[name].to_numpy(float))) > 0
    ]


def _known(values: np.ndarray) -> np.ndarray:
    finite = values[~np.isnan(values)]
    return finite if len(finite) else np.zeros(1)
