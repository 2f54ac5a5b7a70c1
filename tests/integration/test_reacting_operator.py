"""Runs with and without the cue: pairs that differ in the reaction alone."""

import pandas as pd
import pytest

import ravenjax as rj

pytestmark = pytest.mark.slow

DRIFT = {
    "site": "packet",
    "channel": "delx",
    "effect": "offset",
    "value": [20, -20, 10],
    "start_ms": 1000,
}
CAMPAIGN = {
    "campaign": {"name": "reacting", "duration_s": 2.5, "noise": True},
    "reaction": {"action": "none", "delay_ms": 300.0},
    "cross": {"reaction": {"action": [0, 1, 2, 3]}},
    "group": [
        {"name": "free"},
        {"name": "drift", "fault": [DRIFT]},
        {"name": "random", "fault": [{**DRIFT, "effect": "random", "value": 40}]},
    ],
}


@pytest.fixture(scope="module")
def table():
    return rj.run(CAMPAIGN, engine="simd")


@pytest.fixture(scope="module")
def by_action(table):
    """Outcomes of the drift group by action, rows as without a cue."""
    drift = table[table["group"] == "drift"]
    return {
        int(a): rows.set_index("pair").sort_index()
        for a, rows in drift.groupby("param:reaction.action")
    }


def test_pairs_differ_in_the_reaction_alone(table):
    assert len(table) == 20
    inputs = [
        "group",
        "seed",
        "fault0_channel",
        "fault0_value",
        "fault0_start_ms",
        "fault0_duration_ms",
    ]
    for _, rows in table.groupby("pair"):
        assert rows["param:reaction.action"].tolist() == [0, 1, 2, 3]
        assert len(rows[inputs].fillna(0).drop_duplicates()) == 1
        assert rows["pair"].iloc[0] == rows["index"].iloc[0]
    assert table["run_id"].is_unique


def test_pairs_share_their_noise_until_somebody_reacts(table):
    """Without a cue nobody reacts, and four runs with noise come out to the bit alike."""
    outcomes = table.columns[table.columns.str.contains("deviation|margin|path|force|peak_dac")]
    free = table[(table["group"] == "free")]
    assert (free["cue0_first_ms"] < 0).all() and (free["reaction_ms"] < 0).all()
    assert len(free[outcomes].fillna(0).drop_duplicates()) == 1


def test_the_reaction_comes_its_delay_after_the_cue(by_action):
    for action in (1, 2, 3):
        rows = by_action[action]
        assert ((rows["reaction_ms"] - rows["cue0_first_ms"]) == 300).all()
    assert (by_action[0]["reaction_ms"] == -1).all()
    pd.testing.assert_series_equal(by_action[0]["cue0_first_ms"], by_action[1]["cue0_first_ms"])


def test_the_foot_off_the_pedal_stops_the_arm(by_action):
    released, deaf = by_action[1], by_action[0]
    assert (released["end_runlevel"] == 2).all() and (deaf["end_runlevel"] == 3).all()
    assert (released["pedal_down_ms"] < deaf["pedal_down_ms"]).all()
    assert (released["peak_live_deviation_mm"] < 0.75 * deaf["peak_live_deviation_mm"]).all()
    assert (released["tip_path_mm"] < deaf["tip_path_mm"]).all()


def test_correction_keeps_the_instrument_where_it_was_meant_to_be(by_action):
    """The golden run goes where the operator means to go; an eye that corrects keeps a drifting
    tip near it.
    """
    corrected, deaf = (
        by_action[3]["peak_golden_deviation_mm"],
        by_action[0]["peak_golden_deviation_mm"],
    )
    assert (corrected < 0.5 * deaf).all()
