"""Which conclusions depend on the robot: each rate of the report against each parameter that was
varied. And rates on one robot, where whole robots were drawn from a file of `ravenjax calibrate`.

Such a file has the robots that a log leaves likely, and the logged one is as likely to be any of
them. A robot is what was sampled: the interval is of the rate that one more of them would have,
however many faults each had.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd

from ravenjax.hazards.naming import kind_of
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import Section
from ravenjax.stats import one_unit
from ravenjax.stats.bootstrap import units
from ravenjax.stats.inputs.dependence import Dependence, dependences
from ravenjax.stats.intervals import Rate, share
from ravenjax.store.access.query import RESULTS, quoted

LEAST_RUNS = 20
"""Of a conclusion; with fewer, thirds of a parameter hold too few for any statement."""
MOST = 200_000
"""Runs that are looked at one by one; a dependence that these do not show changes a rate by less
than a point.
"""
_WHOLE = "together"
"""The form of a table of values that is drawn in one with others."""


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


class RobotRate(NamedTuple):
    """One rate."""

    name: str
    rate: Rate  # k of n faults on all robots; the 95 % interval is of one robot
    robots: int
    deviation: float  # standard deviation of the robots' rates


def conclusions(runs: Runs) -> list[Conclusion]:
    """The report's rates over one run of each fault, against every parameter that varies among
    them.

    Faults of one kind (a hazard, or a group) resemble each other, and so do faults on one robot:
    intervals and tests count kinds, or robots where these were drawn whole. Rates are of all such
    runs; how they depend on a parameter is asked of MOST of them, drawn, where there are more.
    """
    robots = drawn_whole(runs)
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
            if robots:
                whole = mine.groupby(robots, dropna=False, sort=False).ngroup()
                among = units.units(whole.to_numpy())
            else:
                among = units.units(mine["group"].astype(str).map(kind_of).to_numpy())
            links = dependences(mine[f"hit{i}"].to_numpy(bool), inputs_of, among)
            result.append(
                Conclusion(name, share(k, n), len(mine), among.count, bool(robots), links)
            )
    return result


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
    inputs = [name for name in frame if name.startswith("param:") and not name.startswith(prefixes)]
    return [name for name in inputs if bool(frame[name].max() > frame[name].min())]


def rates(runs: Runs) -> list[RobotRate]:
    """One run of each fault and robot, by `questions`; none where robots were not drawn whole."""
    robots = drawn_whole(runs)
    if not robots:
        return []
    robot = f"hash({', '.join(map(quoted, robots))})"
    result = []
    for name, (among, hit) in questions(runs).items():
        rows = runs.table.rows(
            f"SELECT count(*) FILTER ({hit}), count(*) FROM {RESULTS} JOIN {FACTS} USING (row) "
            f"WHERE sample AND faulty AND {among} GROUP BY {robot}"
        )
        if sum(n for _, n in rows) >= LEAST_RUNS:
            one = one_unit.rate([k for k, _ in rows], [n for _, n in rows])
            result.append(RobotRate(name, one.rate, one.units, one.deviation))
    return result


def drawn_whole(runs: Runs) -> list[str]:
    """Columns of the parameters that make up a robot of a file; none where robots were not drawn
    whole.
    """
    return [name for name in columns(runs.manifest.config) if name in runs.names]


def columns(config: Mapping[str, Any]) -> list[str]:
    """Columns of the parameters that make up a robot, of a campaign as its manifest has it."""
    return list(dict.fromkeys(f"param:{path}" for path in _paths(config)))


def _paths(config: Mapping[str, Any]) -> Iterator[str]:
    for table in (config, *config.get("group", ())):
        for path, value in table.get("parameters", {}).items():
            if isinstance(value, Mapping) and _WHOLE in value:
                yield path


def _content(runs: Runs, _: Path) -> dict[str, Any] | None:
    found, own = conclusions(runs), runs.once(rates)
    if not found and not own:
        return None
    return {
        "conclusions": found,
        "dependence_rows": flat(found),
        "your_robot": own,
        "fewest_units": units.FEWEST,
        "few_units": units.FEW,
    }


SECTIONS = (Section("robots", "Robots", 80, _content),)
