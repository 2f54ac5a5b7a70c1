"""Points of a template are runs of an ordinary campaign, however they are batched."""

import zlib

import numpy as np
import pandas as pd
import pytest

from ravenjax.analyses.search.evaluator import Evaluator
from ravenjax.analyses.search.file import loading, outcome
from ravenjax.analyses.search.file.template import Template
from ravenjax.campaign import loading as campaigns
from ravenjax.campaign import plan, runner
from ravenjax.campaign.faults import sampling

WANTED = ("peak_model_deviation_mm", "response = stopped")
FAULT = {
    "site": "usb_out",
    "channel": ["shoulder", "elbow"],
    "effect": ["overwrite", "random"],
    "value": {"uniform": [0, 12000]},
    "start_ms": {"uniform": [250, 300]},
    "duration_ms": [1, 20, "end"],
}
RAW = {
    "campaign": {"name": "points", "duration_s": 0.6, "seed": 5, "noise": True},
    "operator": {"motion": "reach"},
    "parameters": {"plant.friction_scale": {"uniform": [0.7, 1.4]}, "plant.mass_scale": 1.1},
    "search": {"kind": "sobol", "outcomes": list(WANTED), "n": 8},
    "group": [{"name": "dac", "fault": [FAULT]}],
}


@pytest.fixture(scope="module")
def template():
    return Template(loading.from_dict(RAW).campaign)


@pytest.fixture(scope="module")
def points(template):
    rng = np.random.default_rng(0)
    case = rng.integers(0, template.cases, 40)
    return case, template.values(case, rng.random((40, 3)))


@pytest.fixture(scope="module")
def evaluated(template, points):
    """An evaluator that has run the points in batches of unequal sizes, and what it returned."""
    evaluator = Evaluator(template, [outcome.parse_outcome(text) for text in WANTED])
    case, values = points
    batches = (slice(0, 3), slice(3, 4), slice(4, 40))
    found = [evaluator(case[rows], values[rows]) for rows in batches]
    return evaluator, np.concatenate(found)


def different(one: pd.DataFrame, other: pd.DataFrame) -> list[str]:
    """Columns that differ, numbering apart; rows are matched by id, NaN is NaN."""
    one, other = (
        frame.drop(columns=["index", "pair"]).set_index("run_id") for frame in (one, other)
    )
    other = other.loc[one.index, one.columns]
    return [name for name in one if not one[name].astype(object).equals(other[name].astype(object))]


@pytest.mark.slow
def test_rows_are_those_of_a_campaign_of_listed_runs(template, points, evaluated):
    """A file that lists each run by itself gives the same ids and, to the bit, the same outcomes:
    effect "random", noise and golden runs of varied parameters included."""
    case, values = points
    raw = {key: value for key, value in RAW.items() if key != "search"}
    fault = FAULT | {"channel": "shoulder", "effect": "overwrite"}
    fault |= {"value": 0, "start_ms": 1, "duration_ms": 1}
    runs = []
    for c, (value, start, friction) in zip(case, values.tolist(), strict=True):
        told = {name.removeprefix("fault0_"): word for name, word in template.case(c).items()}
        own = {**told, "value": value, "start_ms": int(start)}
        runs.append({"fault": [own], "parameters": {"plant.friction_scale": friction}})
    listed = raw | {"group": [{"name": "dac", "design": "list", "fault": [fault], "run": runs}]}
    frame = runner.run_campaign(campaigns.from_dict(listed)).frame()
    evaluator, found = evaluated
    rows = evaluator.rows().to_pandas()
    assert set(frame.columns) == set(rows.columns) and different(frame, rows) == []
    np.testing.assert_array_equal(found[:, 0], frame["peak_model_deviation_mm"])
    np.testing.assert_array_equal(found[:, 1], frame["response"] == "stopped")
    assert rows["index"].tolist() == rows["pair"].tolist() == list(range(len(rows)))


def test_unit_points_become_the_values_that_a_sampled_design_draws():
    """The same points of the cube through a campaign of design "sobol" and through a template."""
    group = FAULT | {"channel": "elbow", "effect": "overwrite"}
    group["duration_ms"] = {"loguniform": [1, 90]}
    raw = {k: v for k, v in RAW.items() if k != "search"} | {
        "group": [{"name": "dac", "design": "sobol", "runs": 32, "fault": [group]}]
    }
    config = campaigns.from_dict(raw)
    table = plan.make_plan(config).rows
    single = raw | {"group": [{"name": "dac", "fault": [group]}]}
    template = Template(campaigns.from_dict(single))
    names = ("fault0_value", "fault0_start_ms", "fault0_duration_ms", "plant.friction_scale")
    assert template.labels == names
    rng = np.random.default_rng([5, zlib.crc32(b"dac")])
    unit = sampling._draw_points("sobol", 32, 4, rng)
    case = np.zeros(32, int)
    rows = plan.make_plan(template.campaign(case, template.values(case, unit))).rows
    assert rows["run_id"].tolist() == table["run_id"].tolist()
