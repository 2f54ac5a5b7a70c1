"""Which conclusions hang on the robot, on rows in which one parameter decides."""

from __future__ import annotations

import numpy as np
import synthetic_results as synthetic

from ravenjax.report import dependence
from ravenjax.report.runs import Runs
from ravenjax.stats.intervals import wilson

RUNS = 900
FRAME = synthetic.frame(RUNS)
FRAME["param:plant.mass_scale"] = np.linspace(0.9, 1.1, RUNS)
FRAME["param:reaction.delay_ms"] = np.arange(RUNS) % 7.0
FRAME["param:operator.scale"] = np.nan


def runs_of(frame):
    return Runs.of(frame, synthetic.manifest(len(frame)))


def decided():
    """Harm where and only where friction is low."""
    low = FRAME["param:plant.friction_scale"] < 1.0
    return FRAME.assign(moved_first_ms=np.where(low, 900, -1), jump_code=False)


def test_the_parameter_that_decides_is_found_and_the_others_are_not():
    frame = decided()
    found = {one.name: one for one in dependence.conclusions(runs_of(frame))}
    harm = found["does harm"]
    chosen = (frame["fault0_site"] != "") & (frame["failed"] == "")
    hits = chosen & (frame["moved_first_ms"] >= 0)
    assert harm.rate == wilson(int(hits.sum()), int(chosen.sum()))
    by_name = {item.name: item for item in harm.found}
    assert set(by_name) == {"plant.friction_scale", "plant.mass_scale"}
    assert by_name["plant.friction_scale"].depends and not by_name["plant.mass_scale"].depends
    assert by_name["plant.friction_scale"].difference.value == -1
    assert harm.found[0].name == "plant.friction_scale"


def test_only_what_varies_of_the_robot_is_asked():
    names = dependence.varied(FRAME)
    assert names == ["param:plant.friction_scale", "param:plant.mass_scale"]
    assert dependence.conclusions(runs_of(FRAME.drop(columns=names))) == []


def test_rows_for_a_table_have_levels_side_by_side():
    frame = decided()
    rows = dependence.flat(dependence.conclusions(runs_of(frame)))
    one = next(row for row in rows if row["conclusion"] == "does harm" and row["parameter"] == "plant.friction_scale")
    assert one["lowest_third"].rate.value == 1 and one["highest_third"].rate.value == 0


def test_a_rate_of_few_runs_is_no_conclusion():
    frame = decided().head(dependence.LEAST_RUNS - 1)
    assert dependence.conclusions(runs_of(frame)) == []
