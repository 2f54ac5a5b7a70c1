"""What a stop rule sees of a campaign: groups as strata, events as the report means them, its
mistakes named.
"""

import naive_facts
import numpy as np
import pyarrow as pa
import pytest
import synthetic_results as synthetic

from ravenjax.campaign import loading
from ravenjax.campaign.faults import design
from ravenjax.campaign.stop import decisions
from ravenjax.campaign.stop.adaptive import stop_rule
from ravenjax.errors import StoreError, UserError
from ravenjax.outcomes import events
from ravenjax.outcomes.events import Rules

FAULT = {"site": "usb_out", "channel": "elbow", "effect": "overwrite", "start_ms": 5}
GROUPS = [
    {"name": "free"},
    {
        "name": "grid",
        "fault": [FAULT | {"value": list(range(40)), "duration_ms": [1, 2, 4, 8, 16]}],
    },
    {
        "name": "drawn",
        "design": "sobol",
        "runs": 64,
        "fault": [FAULT | {"value": {"uniform": [0, 99]}}],
    },
]


def config(stop=None, groups=GROUPS, **more):
    return loading.from_dict(
        {
            "campaign": {"name": "x"},
            "stop": {"half_width": 0.1} | (stop or {}),
            "group": groups,
            **more,
        }
    )


def test_the_beginning_of_a_grid_is_a_sample_of_it():
    table = design.table_columns(config())
    rows = table[table["group"] == "grid"]
    begun = rows.iloc[:100]
    assert len(begun.groupby(["fault0_value", "fault0_duration_ms"])) == 100
    assert (begun["fault0_duration_ms"].value_counts().reindex([1, 2, 4, 8, 16]) >= 10).all(), (
        "not a corner of it"
    )
    assert abs(begun["fault0_value"].mean() - 19.5) < 4
    again = design.table_columns(config(campaign={"name": "x", "seed": 1}))
    assert again["fault0_value"].tolist() != table["fault0_value"].tolist(), (
        "the seed draws the order"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "event", ["evades", "unintended_motion", "loss_of_motion", "false_report", "cue", "stopped"]
)
def test_events_are_those_of_the_report(event):
    frame = synthetic.judged(synthetic.frame(3000), cue=2)
    rules = Rules(cue=2, threshold_mm=2.0, jump="jump_text")
    said = naive_facts.derive(frame, rules.cue, rules.jump)
    columns = {"evades": "evaded", "unintended_motion": "unintended", "loss_of_motion": "loss"}
    columns |= {"false_report": "misreport", "cue": "cued"}
    expected = said["response"] == event if event == "stopped" else said[columns[event]]
    rows = pa.Table.from_pandas(frame[events.event_columns([event], rules)])
    valid, cases = events.events_happened(rows, [event], rules)
    assert valid.tolist() == (~said["failed"]).tolist() and 0 < valid.sum() < len(frame)
    assert cases[valid].tolist() == expected[valid].tolist()
    assert 0 < expected[valid].sum() < valid.sum(), "the example tells them apart"


@pytest.mark.parametrize(
    ("stop", "key", "message"),
    [
        ({"rates": ["cue", "cue"]}, "stop", "rates = ['cue', 'cue'], expected each rate once"),
        ({"looks": [0.5, 0.2]}, "stop", "looks = [0.5, 0.2], expected increasing shares"),
    ],
)
def test_what_is_wrong_is_said_with_its_key(stop, key, message):
    with pytest.raises(UserError) as wrong:
        config(stop)
    assert f"{key}: " in str(wrong.value) and message in str(wrong.value)


def test_a_limit_and_a_stop_rule_exclude_each_other(tmp_path):
    path = tmp_path / "c.toml"
    fault = "".join(f"{key} = {value!r}\n" for key, value in FAULT.items())
    group = f'[[group]]\nname = "g"\n[[group.fault]]\n{fault}value = 1\n'
    path.write_text(f'[campaign]\nname = "x"\n\n[stop]\nhalf_width = 0.1\n\n{group}')
    assert loading.load_campaign(path).stop is not None
    with pytest.raises(
        UserError,
        match=(
            r"c.toml:4: stop: campaign.limit = 5 would shorten .* such as looks = \[0.01,"
            r" 0.05\]"
        ),
    ):
        loading.load_campaign(path, ["campaign.limit=5"])


def test_decisions_are_read_back_and_a_damaged_file_is_named(tmp_path):
    assert decisions.read_looks(tmp_path) == [] and decisions.describe_stop(tmp_path) == ""
    rule = stop_rule(config())
    look = rule.decide(1, rule.sizes()[0], np.array([[0, 1, 0], [0, 2, 0]]), rule.sizes()[0])
    decisions.write_looks(tmp_path, [look])
    assert [one.model_dump_json() for one in decisions.read_looks(tmp_path)] == [
        look.model_dump_json()
    ]
    assert decisions.describe_stop(tmp_path).startswith("Not stopped yet: at look 1 of 21")
    (tmp_path / decisions.FILE).write_text(look.model_dump_json()[:50])
    with pytest.raises(
        StoreError, match=r"decisions.jsonl: cannot be read .* Delete it and start the same"
    ):
        decisions.read_looks(tmp_path)
