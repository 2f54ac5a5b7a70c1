"""Expansion of designs into the fault table, against naive expansions written out by hand."""

import math

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
    return design.expand(loading.from_dict({**BASE, "group": list(groups), **sections}))


def group(name="g", **keys):
    faults = keys.pop("faults", [FAULT])
    return {"name": name, "fault": faults, **keys}


def test_zip_takes_lists_of_one_length_only():
    """ "*" is a list as well, of the site's channels."""
    with pytest.raises(
        UserError,
        match=r"'g': design 'zip' needs lists of one length, got channel of slot 0: 7, value",
    ):
        expand(group(design="zip", faults=[{**FAULT, "channel": "*", "value": [1, 2, 3]}]))


def test_list_replaces_what_each_run_names():
    runs = [
        {"fault": [{"value": 5}]},
        {"fault": [{"channel": "elbow", "duration_ms": 7}], "parameters": {"plant.a": 3}},
    ]
    table = expand(group(design="list", run=runs))
    assert table["fault0_value"].tolist() == [5.0, 1.0]
    assert table["fault0_channel"].tolist() == ["shoulder", "elbow"]
    assert table["fault0_duration_ms"].tolist() == [-1, 7]
    assert math.isnan(table["param:plant.a"][0]) and table["param:plant.a"][1] == 3.0


def test_list_checks_each_run():
    with pytest.raises(UserError, match=r"run\[1\].*start_ms"):
        expand(group(design="list", run=[{}, {"fault": [{"start_ms": -3}]}]))
    with pytest.raises(UserError, match="unknown channel"):
        expand(group(design="list", run=[{"fault": [{"channel": "elbw"}]}]))


def test_limit_is_no_part_of_the_table():
    """How many rows are computed is the runner's business: the table, its ids and its count stay
    as they are.
    """
    one = group(faults=[{**FAULT, "value": [1, 2, 3, 4]}])
    config = loading.from_dict({**BASE, "campaign": {"name": "x", "limit": 2}, "group": [one]})
    assert design.expand(config).equals(expand(one)) and design.count(config) == 4


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
    "keys, message",
    [
        ({"effect": "bit_flip", "value": 16}, "0..15"),
        ({"value": 1.5}, "whole number"),
        (
            {"value": 2**15},
            "16-bit number: expected -32768..32767, got 32768, which would wrap to -32768",
        ),
        (
            {"site": "encoder", "value": 2**23},
            "24-bit number: expected -8388608..8388607, got 8388608",
        ),
        ({"site": "brake", "channel": "engaged", "value": 2}, "0 or 1"),
    ],
)
def test_values_that_a_channel_cannot_take(keys, message):
    with pytest.raises(UserError, match=message):
        expand(group(faults=[{**FAULT, **keys}]))


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
