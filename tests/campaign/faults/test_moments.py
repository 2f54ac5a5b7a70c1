"""Onsets in phases of the operation: which milliseconds, how they are drawn, what is refused."""

import numpy as np
import pytest

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.errors import UserError

FAULT = {
    "site": "usb_out",
    "channel": "elbow",
    "effect": "overwrite",
    "value": 9000,
    "duration_ms": 5,
}


def campaign(start, group=None, fault=None, **sections):
    return {
        "campaign": {"name": "moments", "duration_s": 6.0, **sections.pop("campaign", {})},
        "operator": {"motion": "clutched", **sections.pop("operator", {})},
        "group": [
            {"name": "g", **(group or {}), "fault": [{**FAULT, "start_ms": start, **(fault or {})}]}
        ],
        **sections,
    }


def starts(*args, **kwargs):
    return (
        plan.make_plan(rj.load_campaign(campaign(*args, **kwargs)))
        .rows["fault0_start_ms"]
        .to_numpy()
    )


def phases(**sections):
    config = rj.load_campaign(campaign(0, **sections))
    stretches_of = config.robot.part("campaign").phases(config)
    masks = {name: np.zeros(config.campaign.ticks, bool) for name in stretches_of}
    for name, stretches in stretches_of.items():
        for begin, end in stretches.tolist():
            masks[name][begin:end] = True
    return config, masks


def test_pedal_down_is_where_the_robot_is_in_it():
    config, masks = phases()
    levels = rj.simulate(
        config.model_copy(update={"group": (config.group[0].model_copy(update={"fault": ()}),)}), 0
    )
    np.testing.assert_array_equal(masks["pedal_down"], levels["runlevel"].values == 3)
    np.testing.assert_array_equal(masks["pedal_up"], ~masks["pedal_down"])


def test_fast_and_slow_part_pedal_down_by_the_speed_of_the_tip():
    config, masks = phases()
    np.testing.assert_array_equal(masks["fast"] | masks["slow"], masks["pedal_down"])
    assert not (masks["fast"] & masks["slow"]).any()
    free = config.model_copy(update={"group": (config.group[0].model_copy(update={"fault": ()}),)})
    tip = rj.simulate(free, 0)["tip"].sel(arm="gold").values
    speed = np.linalg.norm(np.gradient(tip, axis=0), axis=1)
    assert np.median(speed[masks["fast"]]) > 3.0 * np.median(speed[masks["slow"]])


def test_draws_are_of_the_phase_alike_everywhere_and_the_same_again():
    onsets = starts({"phase": "fast"}, {"design": "random", "runs": 4000})
    _, masks = phases()
    ticks = np.flatnonzero(masks["fast"])
    assert np.isin(onsets, ticks).all()
    share = np.searchsorted(ticks, onsets) / len(ticks)
    assert np.abs(np.histogram(share, 10, (0, 1))[0] / 4000 - 0.1).max() < 0.02
    np.testing.assert_array_equal(
        onsets, starts({"phase": "fast"}, {"design": "random", "runs": 4000})
    )
    other = starts({"phase": "fast"}, {"design": "random", "runs": 4000}, campaign={"seed": 1})
    assert (onsets != other).any()
    even = starts({"phase": "fast"}, {"design": "lhs", "runs": 100})
    assert (
        np.abs(np.sort(np.searchsorted(ticks, even)) / len(ticks) - np.arange(100) / 100).max()
        < 0.02
    )


def test_shares_are_places_among_the_ticks_of_a_phase():
    ticks = np.flatnonzero(phases()[1]["slow"])
    assert starts({"phase": "slow", "share": [0, 0.5, 1]}).tolist() == [
        ticks[0],
        ticks[round(0.5 * (len(ticks) - 1))],
        ticks[-1],
    ]
    assert starts([700, {"phase": "slow", "share": 0.0}]).tolist() == [700, ticks[0]]
    onsets = starts(
        {"choice": [700, {"phase": "slow", "share": 1}]}, {"design": "random", "runs": 50}
    )
    assert set(onsets.tolist()) == {700, ticks[-1]}
    run = {"design": "list", "run": [{"fault": [{"start_ms": {"phase": "slow", "share": 1}}]}]}
    assert starts(10, run).tolist() == [ticks[-1]]


def test_a_moment_of_a_phase_needs_the_trigger_time():
    with pytest.raises(UserError, match=r"the phase 'fast', which needs trigger = 'time'"):
        rj.load_campaign(campaign({"phase": "fast", "share": 0.1}, fault={"trigger": "pedal"}))


def test_a_phase_that_never_comes_is_refused_before_anything_runs():
    with pytest.raises(
        UserError,
        match=r"(?s)fault\[0\].start_ms: phase 'in_tissue'.*does not occur.*expected one of",
    ):
        starts({"phase": "in_tissue", "share": 0.5})
