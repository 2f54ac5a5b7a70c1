"""Which conclusions depend on the robot: each rate of the report against each parameter that was varied."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from ravenjax.report import tables
from ravenjax.stats.association import Dependence, dependences
from ravenjax.stats.intervals import Rate

LEAST_RUNS = 20
"""Of a conclusion; with fewer, thirds of a parameter hold too few for any statement."""


class Conclusion(NamedTuple):
    """One rate and how it hangs on each varied parameter, the clearest first; Holm over the parameters."""

    name: str
    rate: Rate
    found: list[Dependence]


def conclusions(frame: pd.DataFrame, facts: pd.DataFrame) -> list[Conclusion]:
    """The report's rates over one run of each fault, against every parameter that varies among them."""
    chosen = facts["sample"] & facts["faulty"]
    names = varied(frame.loc[chosen])
    if not names:
        return []
    asked = {
        "evades the checks and moves the instrument": (chosen, facts["evaded"]),
        "does harm": (chosen, facts["harm"]),
        "a check responds": (chosen, facts["response"] != "silent"),
        "the cue fires before the harm": (
            chosen & facts["harm"],
            (facts["warned_ms"] >= 0) & (facts["warned_ms"] < facts["harm_ms"]),
        ),
    }
    made = []
    for name, (among, hit) in asked.items():
        hits = np.asarray(hit)[np.asarray(among)]
        if len(hits) >= LEAST_RUNS:
            inputs = {path.removeprefix("param:"): frame.loc[among, path].to_numpy() for path in names}
            made.append(Conclusion(name, tables.rate(hits), dependences(hits, inputs)))
    return made


def flat(made: list[Conclusion]) -> list[dict[str, Any]]:
    """One row a conclusion and parameter, levels side by side."""
    return [
        {"conclusion": one.name, "parameter": item.name, "n": item.n, "p": item.p, "adjusted": item.adjusted}
        | {"depends": item.depends, "difference": item.difference}
        | {level.name.replace(" ", "_"): level for level in item.levels}
        for one in made
        for item in one.found
    ]


def varied(frame: pd.DataFrame) -> list[str]:
    """Columns of parameters of robot and operation that vary in a table; the cue and the reaction to it are choices of
    the campaign and no uncertainty of the robot."""
    chosen = ("param:reaction.", "param:haptics.", "param:detectors.")
    return [
        name
        for name in frame
        if name.startswith("param:") and not name.startswith(chosen) and np.ptp(_known(frame[name].to_numpy(float))) > 0
    ]


def _known(values: np.ndarray) -> np.ndarray:
    known = values[~np.isnan(values)]
    return known if len(known) else np.zeros(1)
