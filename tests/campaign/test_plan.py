"""What a plan makes of the fault table's columns."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

import ravenjax as rj
from ravenjax.campaign import plan

FAULT = {"site": "usb_out", "channel": "elbow", "effect": "overwrite", "value": [1, 2, 3], "start_ms": 5}
CAMPAIGN = {"campaign": {"name": "x", "duration_s": 0.02}, "group": [{"name": "a", "fault": [FAULT]}]}

columns = st.integers(1, 4).flatmap(
    lambda n: st.lists(st.tuples(*[st.sampled_from([0.0, 0.5, 1.0, -2.0])] * n), min_size=1, max_size=30)
)


@given(columns)
def test_runs_share_a_twin_exactly_where_all_parameters_agree(rows):
    varied = {str(k): np.array(column, np.float32) for k, column in enumerate(zip(*rows, strict=True))}
    twin = plan._twins(varied, len(rows))
    first = {row: i for i, row in reversed(list(enumerate(rows)))}
    numbered = sorted(set(first.values()))
    assert twin.tolist() == [numbered.index(first[row]) for row in rows], "numbered as they come"


def test_without_parameters_all_share_one():
    assert plan.make(rj.load_campaign(CAMPAIGN)).twin.tolist() == [0, 0, 0]


def test_with_noise_every_run_draws_its_own_and_has_a_twin_that_draws_the_same():
    noisy = {**CAMPAIGN, "campaign": {**CAMPAIGN["campaign"], "noise": True}}
    ready = plan.make(rj.load_campaign(noisy))
    keys = ready.varied[plan.NOISE_KEY]
    assert keys.dtype == np.uint32 and len(set(keys.tolist())) == 3
    assert ready.twin.tolist() == [0, 1, 2]
    assert not np.isin(keys, ready.faults["key"]).any(), "noise and random effects are strangers"
