"""Expansion of designs into the fault table: ids, arms, values and what is refused."""

import pytest

from ravenjax.campaign import loading
from ravenjax.campaign.faults import design
from ravenjax.errors import UserError

BASE = {"campaign": {"name": "x"}, "operator": {"motion": "still"}}
FAULT = {
    "site": "usb_out",
    "channel": "shoulder",
    "effect": "overwrite",
    "value": 1,
    "start_ms": 100,
}


def expand(*groups, **sections):
    return design.table_columns(loading.from_dict({**BASE, "group": list(groups), **sections}))


def group(name="g", **keys):
    faults = keys.pop("faults", [FAULT])
    return {"name": name, "fault": faults, **keys}


def test_list_checks_each_run():
    with pytest.raises(UserError, match=r"run\[1\].*start_ms"):
        expand(group(design="list", run=[{}, {"fault": [{"start_ms": -3}]}]))
    with pytest.raises(UserError, match="unknown channel"):
        expand(group(design="list", run=[{"fault": [{"channel": "elbw"}]}]))


@pytest.mark.parametrize(
    "name, same", [("chunk", True), ("description", True), ("level", False), ("duration_s", False)]
)
def test_run_id_depends_on_what_decides_the_run(name, same):
    value = {"chunk": 7, "description": "d", "level": "advanced", "duration_s": 4.0}[name]
    one, other = expand(group()), expand(group(), campaign={"name": "y", name: value})
    assert bool(one["run_id"][0] == other["run_id"][0]) is same


def test_arm_is_implied_with_one_arm_and_asked_for_with_two():
    assert expand(group())["fault0_arm"][0] == "gold"
    both = {"name": "x", "arms": ["gold", "green"]}
    with pytest.raises(UserError, match="arm: missing"):
        expand(group(), campaign=both)
    table = expand(group(faults=[{**FAULT, "arm": ["gold", "green"]}]), campaign=both)
    assert table["fault0_arm"].tolist() == ["gold", "green"]


@pytest.mark.parametrize(
    ("fault", "campaign"),
    [
        ({"wraps": True}, {}),
        ({}, {"dac_words": "wrap"}),
        ({}, {"dac_words": "saturate"}),
        ({"site": "current_cmd", "wraps": True}, {}),
    ],
)
def test_dac_values_beyond_16_bit_are_taken_where_the_campaign_says_so(fault, campaign):
    table = expand(
        group(faults=[{**FAULT, "value": 800000, **fault}]), campaign={"name": "x", **campaign}
    )
    assert table["fault0_value"][0] == 800000.0


def test_dac_words_is_about_usb_words_alone():
    with pytest.raises(
        UserError, match="would wrap to 13568; if that is meant, write wraps = true here"
    ):
        expand(
            group(faults=[{**FAULT, "site": "current_cmd", "value": 800000}]),
            campaign={"name": "x", "dac_words": "saturate"},
        )
