"""Fault table to engine arrays: codes, keys, translation of network effects."""

import pytest

from ravenjax import robots
from ravenjax.campaign import loading
from ravenjax.campaign.faults import design, table
from ravenjax.vocabulary.effects import EFFECT_CODES, TRIGGER_CODES

CONFIG = {
    "campaign": {"name": "x", "arms": ["gold", "green"], "dac_words": "wrap"},
    "operator": {"motion": "still"},
    "group": [
        {"name": "free"},
        {
            "name": "late",
            "fault": [
                {
                    "site": "usb_out",
                    "arm": ["green", "gold"],
                    "channel": ["wrist", "elbow"],
                    "effect": ["toggle", "overwrite"],
                    "value": 800000,
                    "trigger": ["pedal", "time"],
                    "start_ms": 10,
                    "duration_ms": [5, "end"],
                },
                {
                    "site": "brake",
                    "effect": "overwrite",
                    "value": 1,
                    "start_ms": 3,
                    "duration_ms": 2,
                    "every_ms": 40,
                },
            ],
        },
        {
            "name": "net",
            "fault": [
                {
                    "site": "network",
                    "effect": ["drop", "duplicate", "delay"],
                    "value": 7,
                    "start_ms": 1,
                    "duration_ms": 4,
                }
            ],
        },
        {
            "name": "wave",
            "fault": [
                {
                    "site": "tau_d",
                    "arm": "gold",
                    "channel": "elbow",
                    "effect": "periodic",
                    "value": 0.25,
                    "start_ms": 1,
                    "period_ms": 50,
                }
            ],
        },
    ],
}


@pytest.fixture(scope="module")
def runs():
    return design.table_columns(loading.from_dict(CONFIG))


def test_arrays_say_what_the_table_says(runs):
    """Each entry read back through the code book is the row it came from."""
    injection = table.table_injection(runs, robots.USUAL)
    targets, arrays = injection.channels, table.fault_arrays(runs, injection)
    for row, record in enumerate(runs.to_dict("records")):
        for slot in range(2):
            site = record[f"fault{slot}_site"]
            got = {name: values[row, slot] for name, values in arrays.items()}
            if not site:
                assert got["code"] == 0
                continue
            channel = record[f"fault{slot}_channel"]
            assert targets[got["code"] - 1] == (site, record[f"fault{slot}_arm"], channel)
            assert got["trigger"] == TRIGGER_CODES[record[f"fault{slot}_trigger"]]
            assert got["start"] == record[f"fault{slot}_start_ms"]
            assert got["every"] == record[f"fault{slot}_every_ms"]
            assert got["period"] == record[f"fault{slot}_period_ms"]
            duration = record[f"fault{slot}_duration_ms"]
            assert got["duration"] == (2**30 if duration == -1 else duration)
            if site != "network":
                assert got["effect"] == EFFECT_CODES[record[f"fault{slot}_effect"]]
                assert got["value"] == record[f"fault{slot}_value"]


def test_network_effects_are_overwrites(runs):
    injection = table.table_injection(runs, robots.USUAL)
    net = runs[runs["group"].array == "net"]
    arrays, targets = table.fault_arrays(net, injection), injection.channels
    assert [targets[code - 1][2] for code in arrays["code"][:, 0]] == ["lost", "lag", "delay"]
    assert arrays["value"][:, 0].tolist() == [1.0, 1.0, 7.0]
    assert set(arrays["effect"][:, 0]) == {EFFECT_CODES["overwrite"]}


def test_keys_belong_to_run_and_slot_not_to_the_place(runs):
    injection = table.table_injection(runs, robots.USUAL)
    keys = table.fault_arrays(runs, injection)["key"]
    assert len(set(keys.ravel().tolist())) == keys.size
    backwards = table.fault_arrays(runs.iloc[::-1], injection)["key"]
    assert (backwards[::-1] == keys).all()
