"""What a plan makes of the fault table's columns."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import ravenjax as rj
from ravenjax.campaign import loading, plan
from ravenjax.errors import UserError
from ravenjax.robots.raven2.campaign.program import NOISE_KEY

FAULT = {
    "site": "usb_out",
    "channel": "elbow",
    "effect": "overwrite",
    "value": [1, 2, 3],
    "start_ms": 5,
}
CAMPAIGN = {
    "campaign": {"name": "x", "duration_s": 0.02},
    "group": [{"name": "a", "fault": [FAULT]}],
}

columns = st.integers(1, 4).flatmap(
    lambda n: st.lists(
        st.tuples(*[st.sampled_from([0.0, 0.5, 1.0, -2.0])] * n), min_size=1, max_size=30
    )
)


@given(columns)
def test_runs_share_a_golden_run_exactly_where_all_parameters_agree(rows):
    varied = {
        str(k): np.array(column, np.float32) for k, column in enumerate(zip(*rows, strict=True))
    }
    golden = plan.number_golden_runs(varied, len(rows))
    first = {row: i for i, row in reversed(list(enumerate(rows)))}
    numbered = sorted(set(first.values()))
    assert golden.tolist() == [numbered.index(first[row]) for row in rows], "numbered as they come"


def test_with_noise_every_run_draws_its_own_and_has_a_golden_run_that_draws_the_same():
    noisy = {**CAMPAIGN, "campaign": {**CAMPAIGN["campaign"], "noise": True}}
    ready = plan.make_plan(rj.load_campaign(noisy))
    keys = ready.varied[NOISE_KEY]
    assert keys.dtype == np.uint32 and len(set(keys.tolist())) == 3
    assert ready.golden.tolist() == [0, 1, 2]
    assert not np.isin(keys, ready.faults["key"]).any(), "noise and random effects are strangers"


@pytest.mark.parametrize(
    ("key", "told"),
    [
        ("operator.start.insertion_m=0.9", r"got 0\.9, expected less than or equal to 0\.562"),
        ("operator.start.elbow_deg=10", r"got 10, expected greater than or equal to 45"),
    ],
)
def test_a_start_beyond_the_hard_stops_is_refused(key, told):
    with pytest.raises(UserError, match=told):
        loading.from_dict({"campaign": {"name": "x"}, "group": [{"name": "g"}]}, overrides=[key])


@pytest.mark.slow
def test_a_group_that_leaves_a_vector_alone_keeps_the_robots_own():
    """Beside a group that sets all joints of a vector to one number."""
    raw = {
        "campaign": {"name": "x", "duration_s": 0.8},
        "group": [{"name": "set", "parameters": {"nominal": {"kc": 0}}}, {"name": "own"}],
    }
    alone = rj.run({**raw, "group": [{"name": "own"}]}, engine="simd")
    both = rj.run(raw, engine="simd")
    for name in ("peak_model_deviation_mm", "rms_model_deviation_mm", "check_joint_limit_margin"):
        assert both.loc[1, name] == alone.loc[0, name]
        assert name.startswith("check") or both.loc[0, name] != alone.loc[0, name]
    assert both["param:nominal.kc"].tolist()[0] == 0 and np.isnan(both["param:nominal.kc"][1])


KP = [199.4, 104.5, 195.2, 0.0046, 0.0044, 3924.6, 3924.7]


@pytest.mark.parametrize(
    ("table", "path", "values", "told"),
    [
        ("parameters", "nominal.gold.kp", KP, "has two possible meanings.*write { list = "),
        ("cross", "plant.gravity", [0, 1, -9], "gravity.x = 0, .*y = 1, .*z = -9"),
        ("parameters", "reaction.delay_ms", 200, "no 'reaction'. Add the section"),
    ],
)
def test_what_a_list_for_a_vector_may_mean_is_asked(table, path, values, told):
    with pytest.raises(UserError, match=f"(?s){told}"):
        plan.make_plan(rj.load_campaign({**CAMPAIGN, table: {path: values}}))


@pytest.mark.parametrize("values", [{"list": KP}, KP[:5], {"choice": KP}])
def test_levels_of_a_vector_that_can_be_nothing_else(values):
    ready = plan.make_plan(
        rj.load_campaign({**CAMPAIGN, "parameters": {"nominal.gold.kp": values}})
    )
    assert set(np.unique(ready.varied["nominal.gold.kp"])) <= set(np.float32(KP))
