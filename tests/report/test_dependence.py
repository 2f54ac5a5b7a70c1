"""Which conclusions hang on the robot, on rows in which one parameter decides."""

from __future__ import annotations

import naive_facts
import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import robots
from ravenjax.stats.intervals import share

RUNS = 900
FRAME = synthetic.frame(RUNS)
FRAME["param:plant.mass_scale"] = np.linspace(0.9, 1.1, RUNS)
FRAME["param:reaction.delay_ms"] = np.arange(RUNS) % 7.0
FRAME["param:operator.scale"] = np.nan


def runs_of(frame):
    return Runs.of(frame, synthetic.manifest(len(frame)))


def decided():
    """An unintended motion where and only where friction is low."""
    low = FRAME["param:plant.friction_scale"] < 1.0
    return synthetic.judged(FRAME.assign(unintended_first_ms=np.where(low, 900, -1)))


@pytest.mark.slow
def test_the_parameter_that_decides_is_found_and_the_others_are_not():
    frame = decided()
    found = {one.name: one for one in robots.conclusions(runs_of(frame))}
    motion = found["makes an unintended motion"]
    chosen = (frame["fault0_site"] != "") & (frame["failed"] == "")
    hits = chosen & (frame["unintended_first_ms"] >= 0)
    assert motion.rate == share(int(hits.sum()), int(chosen.sum()))
    by_name = {item.name: item for item in motion.dependences}
    assert set(by_name) == {"plant.friction_scale", "plant.mass_scale"}
    assert by_name["plant.friction_scale"].depends and not by_name["plant.mass_scale"].depends
    assert by_name["plant.friction_scale"].difference.value == -1
    assert motion.dependences[0].name == "plant.friction_scale"


@pytest.mark.slow
def test_every_rate_against_a_plain_count():
    found = {one.name: one.rate for one in robots.conclusions(runs_of(FRAME))}
    valid = FRAME[(FRAME["fault0_site"] != "") & (FRAME["failed"] == "")]
    moved, told = valid["unintended_first_ms"] >= 0, valid["response"].isin(["stopped", "flagged"])
    lost = naive_facts.hazard(valid) == "loss of motion"
    counts = {
        "evades the checks": (moved & ~told).sum(),
        "makes an unintended motion": moved.sum(),
        "leads to a loss of motion": lost.sum(),
        "is told of by a check": told.sum(),
    }
    assert found == {name: share(int(k), len(valid)) for name, k in counts.items()}


def test_only_what_varies_of_the_robot_is_asked():
    names = robots.varied(FRAME)
    assert names == ["param:plant.friction_scale", "param:plant.mass_scale"]
    assert robots.conclusions(runs_of(FRAME.drop(columns=names))) == []


@pytest.mark.slow
def test_rows_for_a_table_have_levels_side_by_side():
    frame = decided()
    rows = robots.flat(robots.conclusions(runs_of(frame)))
    one = next(
        row
        for row in rows
        if row["conclusion"] == "makes an unintended motion"
        and row["parameter"] == "plant.friction_scale"
    )
    assert one["lowest_third"].rate.value == 1 and one["highest_third"].rate.value == 0


def test_a_rate_of_few_runs_is_no_conclusion():
    frame = decided().head(robots.LEAST_RUNS - 1)
    assert robots.conclusions(runs_of(frame)) == []
