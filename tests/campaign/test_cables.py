"""What cables carry, as an outcome of a campaign: columns, both choices of what an overloaded
one does, engines.
"""

import numpy as np
import pytest
from cuda_as_cpp import real_or_pretended
from cuda_cases import check_engines
from tiny_campaign import fault

import ravenjax as rj
from ravenjax.campaign import loading, plan
from ravenjax.errors import UserError

COLUMNS = ("cable_load", "cable_overload_first_ms", "cable_overload")
FAULT = fault(
    "usb_out",
    ["shoulder", "elbow"],
    "overwrite",
    [-30000, 2000, 14000, 30000],
    320,
    duration_ms=250,
)


def tables(duration_s: float = 0.65, **campaign) -> dict:
    return {
        "campaign": {
            "name": "x",
            "duration_s": duration_s,
            "parameter_set": "power_consistent",
            **campaign,
        },
        "operator": {"motion": "reach"},
        "group": [{"name": "free"}, {"name": "a", "fault": [FAULT]}],
    }


@pytest.fixture(scope="module")
def holding():
    return rj.run(loading.from_dict(tables()), engine="simd")


@pytest.fixture(scope="module")
def breaking():
    return rj.run(loading.from_dict(tables(cables="break")), engine="simd")


def test_a_cable_parts_when_the_one_that_holds_is_overloaded(holding, breaking):
    for name in COLUMNS[1:]:
        assert (holding[name].astype(str) == breaking[name].astype(str)).all(), name
    over = (holding["cable_overload_first_ms"] >= 0).to_numpy()
    np.testing.assert_allclose(
        breaking["cable_load"][~over], holding["cable_load"][~over], rtol=1e-4
    )
    assert (breaking["cable_load"][over] <= holding["cable_load"][over]).all()
    same = holding.columns.difference(["run_id", *COLUMNS])
    for name in same:
        if holding[name].dtype.kind == "f":
            np.testing.assert_allclose(
                breaking[name][~over], holding[name][~over], rtol=1e-3, atol=1e-3, err_msg=name
            )
        else:
            assert breaking[name][~over].equals(holding[name][~over]), name


@pytest.mark.slow
def test_engine_cuda_has_the_bits_of_engine_simd(monkeypatch, tmp_path):
    real_or_pretended(monkeypatch, tmp_path)
    raw = tables(0.06, cables="break") | {"parameters": {"plant.cable_strength": 20.0}}
    raw["group"] = [{"name": "a", "fault": [{**FAULT, "start_ms": 20, "duration_ms": 30}]}]
    check_engines(plan.make_plan(loading.from_dict(raw)), 3)


def test_cables_do_not_break_under_the_authors_law():
    with pytest.raises(UserError, match="twelve times as hard"):
        plan.make_plan(loading.from_dict(tables(parameter_set="traj3", cables="break")))
