"""Rates on one robot, where a campaign drew whole robots from a file, as `ravenjax calibrate`
writes it.

Such a file has the robots that a log leaves likely, and the logged one is as likely to be any of
them. A robot is what was sampled: the interval is of the rate that one more of them would have,
however many faults each had.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections.dependence import LEAST_RUNS, questions
from ravenjax.stats import one_unit
from ravenjax.stats.intervals import Rate
from ravenjax.store.access.query import RESULTS, quoted
from ravenjax.store.manifest import Manifest

_WHOLE = "together"
"""The form of a table of values that is drawn in one with others."""


class RobotRate(NamedTuple):
    """One rate."""

    name: str
    rate: Rate  # k of n faults on all robots; the 95 % interval is of one robot
    robots: int
    deviation: float  # standard deviation of the robots' rates


def rates(runs: Runs, manifest: Manifest) -> list[RobotRate]:
    """One run of each fault and robot, by `questions`; none where robots were not drawn whole."""
    columns = drawn_whole(runs, manifest)
    if not columns:
        return []
    robot = f"hash({', '.join(map(quoted, columns))})"
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


def drawn_whole(runs: Runs, manifest: Manifest) -> list[str]:
    """Columns of the parameters that make up a robot of a file; none where robots were not drawn
    whole.
    """
    return [name for name in columns(manifest.config) if name in runs.names]


def columns(config: Mapping[str, Any]) -> list[str]:
    """Columns of the parameters that make up a robot, of a campaign as its manifest has it."""
    return list(dict.fromkeys(f"param:{path}" for path in _paths(config)))


def _paths(config: Mapping[str, Any]) -> Iterator[str]:
    for table in (config, *config.get("group", ())):
        for path, value in table.get("parameters", {}).items():
            if isinstance(value, Mapping) and _WHOLE in value:
                yield path
