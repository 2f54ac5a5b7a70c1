"""Section "Robots": prediction intervals for the rates of outcomes on one further robot.

The section appears if the campaign draws whole robots from a file, each with all its parameters.
More faults per robot hardly narrow the intervals, because robots differ.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import pandas as pd

from ravenjax import resources
from ravenjax.report.data.facts import FACTS
from ravenjax.report.data.runs import DISTINCT_FAULTS, Runs
from ravenjax.stats import one_unit, units
from ravenjax.stats.intervals import Rate
from ravenjax.stats.units import Units
from ravenjax.store.access.query import RESULTS, quote_name

MIN_FAULTS = 20
"""Smallest number of faults for a rate."""


class RobotRate(NamedTuple):
    """The rate of one question, with its interval for one more robot."""

    name: str
    rate: Rate  # share of the faults on all robots; the 95 % interval is for one robot
    robots: int
    deviation: float  # standard deviation of the robots' rates


def robot_rates(runs: Runs) -> list[RobotRate]:
    """Return the rate of each outcome, over one run of each fault and robot."""
    robot = robot_sql(runs)
    if not robot:
        return []
    questions = resources.read_tables(__file__, "robots.toml")
    if not runs.manifest.cues:
        del questions["has the cue before the unintended motion"]
    result = []
    # condition: SQL for the faults that a question is about; hit: SQL for those with its outcome.
    for name, (condition, hit) in questions.items():
        rows = runs.table.rows(
            f"SELECT count(*) FILTER ({hit}), count(*) FROM {RESULTS} JOIN {FACTS} USING (row) "
            f"WHERE {DISTINCT_FAULTS} AND {condition} GROUP BY {robot}"
        )
        if sum(n for _, n in rows) >= MIN_FAULTS:
            per_unit = one_unit.rate_per_unit([k for k, _ in rows], [n for _, n in rows])
            result.append(RobotRate(name, *per_unit))
    return result


def robot_sql(runs: Runs) -> str:
    """Return SQL for a number of the robot of a run; "" unless robots were drawn whole."""
    names = [name for name in robot_columns(runs.manifest.config) if name in runs.names]
    return f"hash({', '.join(map(quote_name, names))})" if names else ""


def faults_with_units(runs: Runs, columns: str, where: str) -> pd.DataFrame:
    """Return a table of faults: row, group, `columns` of facts, and the number of the drawn unit.

    If each draw of the campaign is a whole robot, the unit is the robot, else the row.
    """
    robot = robot_sql(runs) or "row"
    return runs.table.frame(
        f'SELECT row, "group"::VARCHAR AS "group", {columns}, unit FROM {FACTS} JOIN (SELECT row,'
        f" {robot} AS unit FROM {RESULTS}) USING (row) WHERE {where} ORDER BY row"
    )


def drawn_units(runs: Runs, faults: pd.DataFrame) -> tuple[Units | None, str]:
    """Return the units of rows of `faults_with_units`, and "faults" or "robots"; or None and ""."""
    unit, group = faults["unit"].to_numpy(), faults["group"].to_numpy()
    if robot_sql(runs):
        # Robots were drawn as a whole, and each group has the same robots.
        return units.group_units(unit), "robots"
    if len(faults) and runs.sampled(set(group)):
        return units.group_units(unit, group), "faults"
    return None, ""


def robot_columns(config: Mapping[str, Any]) -> list[str]:
    """Return the columns of parameters that a stored campaign draws `together`, as whole robots."""
    columns = []
    for table in (config, *config.get("group", ())):
        for path, value in table.get("parameters", {}).items():
            if isinstance(value, Mapping) and "together" in value:
                columns.append(f"param:{path}")
    return list(dict.fromkeys(columns))


SECTIONS = {
    "robots": lambda runs, _: {"your_robot": own} if (own := runs.once(robot_rates)) else None
}
