"""Rates on one robot: as its own count says, and on the page only where robots were drawn whole."""

import dataclasses

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import robots
from ravenjax.stats import one_unit
from ravenjax.store.manifest import Manifest

RUNS, ROBOTS = 1500, 40
FRICTION, OFFSET = "plant.gold.actuators.coulomb.shoulder", "plant.gold.actuators.bias.shoulder"


def manifest(kind: str = "together") -> Manifest:
    values = {kind: [0.01, 0.02]}
    plain = synthetic.manifest(RUNS)
    shape = dataclasses.replace(plain.shape, parameters=(*plain.shape.parameters, FRICTION, OFFSET))
    config = {**plain.config, "parameters": {FRICTION: values, OFFSET: values}}
    return plain.model_copy(update={"config": config, "shape": shape})


@pytest.fixture(scope="module")
def frame():
    """Faults evade on every second robot only."""
    one = synthetic.frame(RUNS)
    robot = np.arange(RUNS) % ROBOTS
    one[f"param:{FRICTION}"], one[f"param:{OFFSET}"] = robot // 2 * 0.01, robot % 2 * 0.02
    return synthetic.judged(one.assign(unintended_first_ms=np.where(robot % 2 == 1, 900, -1)))


def test_rates_are_those_of_a_plain_count_by_robot(frame) -> None:
    valid = frame[(frame["fault0_site"] != "") & (frame["failed"] == "")]
    robot = valid["index"] % ROBOTS
    moved = valid["unintended_first_ms"] >= 0
    told = valid["response"].isin(["stopped", "flagged"])
    rates = {one.name: one for one in robots.robot_rates(Runs.of(frame, manifest()))}
    for name, hits in {
        "evades the checks": moved & ~told,
        "makes an unintended motion": moved,
    }.items():
        expected = one_unit.rate_per_unit(hits.groupby(robot).sum(), hits.groupby(robot).count())
        assert rates[name].robots == ROBOTS and rates[name].rate.k == hits.sum()
        np.testing.assert_allclose(rates[name].rate, expected.rate, rtol=1e-6)
    motion = rates["makes an unintended motion"]
    assert motion.rate.low < 0.05 and motion.rate.high > 0.95  # all or none, by the robot
