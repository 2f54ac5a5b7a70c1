"""The study of the uncertain robot: rates and dependences of made-up runs with known answers,
and the whole.
"""

import math

import numpy as np
import pandas as pd
import pytest

from studies import uncertain_robot
from studies.uncertain_robot import EVENTS, PARAMETERS, Robots, Uncertain

FRICTION = PARAMETERS[0]


def table(faults: int, **hits: list[int]) -> pd.DataFrame:
    """Events of so many faults, each of its own kind: the numbers of those that have each, none
    for the others.
    """
    columns = {event: np.isin(np.arange(faults), hits.get(event, [])) for event in EVENTS}
    layers = np.where(np.arange(faults) % 2, "packets", "USB in")
    return pd.DataFrame({**columns, "layer": layers, "kind": np.arange(faults)})


def ends(faults: int, low: list[int], high: list[int]) -> dict[Uncertain, Robots]:
    robots = {"low": table(faults, unintended=low), "high": table(faults, unintended=high)}
    return {FRICTION: robots}


def test_an_effect_is_a_paired_difference() -> None:
    found = {
        one.event: one
        for one in uncertain_robot.parameter_effects(ends(100, list(range(20)), list(range(10))))
    }
    moved = found["unintended"]
    assert moved.difference.value == pytest.approx(-0.1)
    assert moved.p == pytest.approx(2 * 0.5**10)
    assert math.isnan(found["jump"].p)  # no fault differs: nothing to test
    tested = uncertain_robot.adjusted([moved, found["jump"]])
    assert [one.rejected for _, one in tested] == [True, False]


def test_thirds_find_the_parameter_that_decides() -> None:
    rng = np.random.default_rng(0)
    first, second = PARAMETERS[:2]
    values = rng.uniform(0.5, 2.0, (600, 2))
    frame = pd.DataFrame({first.column: values[:, 0], second.column: values[:, 1]})
    found = table(600, unintended=np.flatnonzero(values[:, 0] > 1.5).tolist())
    told = {
        (one.event, one.parameter): one
        for one in uncertain_robot.dependences(frame, found, (first, second))
    }
    assert told["unintended", first].p < 1e-6 < 0.05 < told["unintended", second].p
    assert told["unintended", first].levels["highest third"].value == 1.0
    assert math.isnan(told["jump", first].p)


@pytest.mark.slow
def test_the_study_runs(reproduced) -> None:
    found = reproduced(uncertain_robot.STUDY, ("campaign.limit=400",))
    plain = found.tables[0]
    assert [row[0] for row in plain.rows] == [*EVENTS.values()]
    for line in found.lines:
        assert line.published is None
        if line.quantity.endswith("over robots"):
            assert line.predicted
            assert line.predicted.low <= line.predicted.value <= line.predicted.high
    decided = next(one for one in found.tables if one.title.startswith("What determines"))
    assert len(decided.rows) == 3 * len(PARAMETERS)
