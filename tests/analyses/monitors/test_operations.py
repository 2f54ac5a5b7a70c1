"""Fault-free operations in bulk: the same scores as a campaign's own runs, on every engine."""

import numpy as np
import pytest

import ravenjax as rj
from ravenjax.analyses.monitors import operations
from ravenjax.analyses.monitors.operations import OperationDesign, OperationRunner
from ravenjax.campaign.loading import validate_tables
from ravenjax.errors import UserError

DETECTOR = "def step(params, state, view):\n    return state, view.tip_error * 1000.0\n"


def config(folder, **tables):
    (folder / "mine.py").write_text(DETECTOR)
    raw = {
        "campaign": {"name": "free", "noise": True, "seed": 5},
        "operator": {"motion": "suture", "scale": 0.08},
        "parameters": {"plant.friction_scale": {"loguniform": [0.5, 2]}},
        "detector": [{"name": "mine", "file": str(folder / "mine.py")}],
        "group": [{"name": "two", "design": "random", "runs": 2}],
    }
    return rj.load_campaign(raw | tables)


DESIGN = OperationDesign(("suture", "clutched"), 3, 1.2, 4)


def by_campaigns(whole, design, number):
    """The same operations, each a run of a campaign of its own kind, beside its golden run."""
    one = operations.campaign_of_operator(
        operations.fault_free_campaign(whole, design), design, number
    )
    return rj.run(validate_tables(one.model_dump(mode="json")), engine="simd")


@pytest.mark.parametrize("engine", ["simd", pytest.param("xla", marks=pytest.mark.slow)])
def test_scores_are_those_of_a_campaign(tmp_path, engine):
    whole = config(tmp_path)
    for one in OperationRunner(whole, DESIGN, engine).compute(range(3)):
        table = by_campaigns(whole, DESIGN, one.operator)
        assert (one.motion, one.seed) == DESIGN.operator(one.operator)
        expected = table["detector0_score"].to_numpy()
        if engine == "simd":
            assert (one.score[:, 0] == expected).all()
        assert np.allclose(one.score[:, 0], expected, rtol=1e-3) and len(set(expected)) == 3
        assert np.allclose(one.hours * 3.6e6, np.maximum(table["pedal_down_ms"] - 500, 0))


def test_an_operator_depends_on_its_number_alone(tmp_path):
    runner = OperationRunner(config(tmp_path), DESIGN, "simd")
    (alone,) = runner.compute([2])
    *_, among = runner.compute(range(3))
    assert (alone.score == among.score).all() and alone.seed == among.seed
    fresh = OperationDesign(*list(DESIGN.__dict__.values())[:4], operations.NEW_STREAM)
    assert not {fresh.operator(n) for n in range(100)} & {DESIGN.operator(n) for n in range(100)}


def test_one_robot_is_one_operation_whatever_the_campaign_lists(tmp_path):
    whole = config(tmp_path, parameters={"plant.friction_scale": [0.5, 1.0, 2.0]})
    design = OperationDesign(**(DESIGN.__dict__ | {"robots": 1}))
    one = next(OperationRunner(whole, design, "simd").compute([0]))
    assert one.score.shape == (1, 1)


@pytest.mark.parametrize(
    ("tables", "design", "message"),
    [
        (
            {"parameters": {}, "campaign": {"name": "free"}},
            {},
            "the 3 robots of an operator would be equal",
        ),
        ({}, {"motions": ("still",)}, "motion 'still' is the same for every seed"),
        ({"cross": {"plant.mass_scale": [0.9, 1.1]}}, {}, r"\[cross\] repeats every run"),
    ],
)
def test_what_cannot_be_drawn_is_refused(tmp_path, tables, design, message):
    if not tables.get("parameters", True):
        tables["group"] = [{"name": "one"}]
    with pytest.raises(UserError, match=message):
        OperationRunner(
            config(tmp_path, **tables), OperationDesign(**(DESIGN.__dict__ | design)), "simd"
        )
