"""Which groups draw their faults, of bundled campaigns and of records by hand."""

import json

import pytest

from ravenjax.campaign import loading
from ravenjax.report.data import draws


def groups(campaign):
    """Of a bundled campaign, by what its manifest would hold."""
    return draws.drawn_groups(json.loads(json.dumps(loading.load_campaign(campaign).model_dump())))


def test_a_group_draws_its_faults_or_enumerates_them():
    config = loading.load_campaign("quick.toml")
    drawn = groups("quick.toml")
    by_name = {group.name: group for group in config.group}
    assert {"dac_unchecked", "packet_offset"} <= drawn
    assert "console_scale" not in drawn and by_name["console_scale"].design == "grid"
    assert "fault_free" not in drawn  # nothing that strikes
    assert groups("uncertain_robot.toml") == {
        group.name for group in loading.load_campaign("uncertain_robot.toml").group if group.fault
    }  # listed values, picked at random


@pytest.mark.parametrize(
    ("group", "drawn"),
    [
        ({"design": "grid", "fault": [{"value": [1, 2, 3], "start_ms": 100}]}, False),
        (
            {"design": "grid", "fault": [{"value": [1, 2, 3], "start_ms": {"uniform": [1, 9]}}]},
            True,
        ),
        ({"design": "grid", "fault": [{"value": {"list": [1, 2]}}]}, False),
        ({"design": "zip", "fault": [{"value": {"choice": [1, 2]}}]}, True),
        ({"design": "lhs", "fault": [{"value": [1, 2]}]}, True),
        ({"design": "lhs", "fault": [{"channel": "all"}]}, True),
        (
            {
                "design": "sobol",
                "fault": [{"value": 1}],
                "parameters": {"friction": {"uniform": [0, 1]}},
            },
            False,
        ),
        ({"design": "list", "fault": [{"value": 1}], "run": [{"fault": [{"value": 2}]}]}, False),
        ({"design": "grid", "fault": []}, False),
        ({"design": "grid", "fault": [{"effect": "lose", "value": [0.01, 0.1]}]}, True),
        ({"design": "grid", "fault": [{"effect": ["lose", "drop"], "value": 0.1}]}, False),
    ],
)
def test_what_is_drawn(group, drawn):
    assert draws.drawn_groups({"group": [{"name": "g", **group}]}) == (
        frozenset({"g"}) if drawn else frozenset()
    )
    assert draws.drawn_groups({}) is None
