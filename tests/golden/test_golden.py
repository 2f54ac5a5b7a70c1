"""A small fixed campaign gives the results that are kept in results.csv, and the comparison can
fail.
"""

import bless
import pytest

from ravenjax.engines import selection
from ravenjax.numbers.setup import CAMPAIGN


@pytest.fixture(scope="module")
def both():
    """The results by this code, of the golden campaign and of one with 2 % more friction in every
    motor and joint.

    One campaign, so one compile; a run's result does not depend on the others in it.
    """
    frame = bless.compute(("parameters.plant.friction_scale=[1.0, 1.02]",), "simd")
    friction = frame["param:plant.friction_scale"]
    return tuple(frame[friction == value].reset_index(drop=True) for value in (1.0, 1.02))


@pytest.fixture
def golden():
    return bless.read()


def test_results_are_the_golden_ones(both, golden):
    assert bless.differences(both[0], golden) == []


def test_golden_results_hold_most_kinds_of_outcome(golden):
    assert set(golden["response"]) == {"silent", "limited", "flagged", "stopped"}
    assert {True, False} == set(golden["jump_code"]) == set(golden["cue0_first_ms"] >= 0)
    assert (golden["failed"] == "").all() and (golden["active_ticks"][1:] > 0).all()


def test_two_percent_of_friction_are_noticed_in_every_run(both, golden):
    changed = both[1].assign(**{"run_id": golden["run_id"], "param:plant.friction_scale": 1.0})
    found = bless.differences(changed, golden)
    assert {line.partition(":")[0] for line in found} == set(golden["group"])


@pytest.mark.slow
@pytest.mark.parametrize("engine", ["xla", "mjx", "cuda"])
def test_every_other_engine_stays_far_inside_the_tolerances(golden, monkeypatch, engine):
    if engine == "cuda" and selection.fastest_engine(CAMPAIGN)[0] != "cuda":
        pytest.skip(selection.fastest_engine(CAMPAIGN)[1])
    monkeypatch.setattr(bless, "RELATIVE", bless.RELATIVE / 10.0)
    monkeypatch.setattr(bless, "ABSOLUTE", bless.ABSOLUTE / 10.0)
    assert bless.differences(bless.compute(engine=engine), golden) == []
