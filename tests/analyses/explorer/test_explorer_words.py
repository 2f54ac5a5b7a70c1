"""What a page says of a campaign, and whether its campaign file is the campaign's own."""

import math
import tomllib

from ravenjax.analyses.explorer import program, words
from ravenjax.campaign import loading
from ravenjax.campaign.loading import validate_tables
from ravenjax.campaign.stop import adaptive
from ravenjax.store import manifest

STUCK = {"site": "usb_out", "channel": "elbow", "effect": "stuck", "start_ms": 9, "duration_ms": 5}


def test_the_file_that_commands_begin_with_says_what_the_campaign_says():
    config = loading.load_campaign("quick")
    told = words.describe_campaign(config)
    raw = tomllib.loads(told["toml"]) | {"haptics": {"combine": "zip", **told["cues"]}}
    again = validate_tables(raw | {"group": [{"name": "explored", "fault": [STUCK]}]})
    assert again.haptics.cues() == config.haptics.cues()
    assert again.deciding() == config.deciding()
    assert told["values"]["usb_out/overwrite"] == [-20000, 20000]
    assert told["varied"] == []


def test_what_a_campaign_varies_is_left_to_the_page():
    raw = {
        "campaign": {"name": "some"},
        "parameters": {"operator.scale": 0.2, "plant.friction_scale": {"uniform": [0.7, 1.4]}},
        "cross": {"plant.mass_scale": [1, 2]},
        "group": [{"name": "own", "fault": [STUCK]}],
    }
    told = words.describe_campaign(validate_tables(raw))
    assert told["varied"] == ["plant.friction_scale", "plant.mass_scale"]
    assert tomllib.loads(told["toml"]) == {
        "campaign": {"name": "some"},
        "parameters": {"operator.scale": 0.2},
        "operator": {"motion": "suture"},
    }


def test_a_motion_may_be_exchanged_where_hands_are_neither_recorded_nor_own(tmp_path):
    """The page puts the name of another motion on the line below [operator]."""
    raw = {"campaign": {"name": "some"}, "group": [{"name": "own", "fault": [STUCK]}]}
    assert program.motion_name(validate_tables(raw)) == "suture"
    circling = validate_tables(raw | {"operator": {"motion": "circle", "seed": 3}})
    assert program.motion_name(circling) == "circle"
    told = words.describe_campaign(circling)
    assert '\n[operator]\nmotion = "circle"\nseed = 3\n' in told["toml"]
    (tmp_path / "hand.csv").write_text("x,y,z\n" + "0,0,0\n" * 3000)
    recorded = {"operator": {"file": str(tmp_path / "hand.csv"), "rate_hz": 1000.0}}
    assert program.motion_name(validate_tables(raw | recorded)) is None


def test_a_table_has_the_runs_that_a_page_can_ask_for(tmp_path):
    timed = STUCK | {"start_ms": 20, "duration_ms": 10}
    shaken = timed | {"effect": "random", "value": 5.0}
    faults = {
        "free": [],
        "timed": [timed],
        "again": [timed | {"every_ms": 40}],
        "packets": [timed | {"trigger": "packet"}],
        "noisy": [shaken],
        "two": [timed, timed | {"channel": "shoulder"}],
    }
    groups = [{"name": name} | ({"fault": own} if own else {}) for name, own in faults.items()]
    config = validate_tables({"campaign": {"name": "some", "duration_s": 0.1}, "group": groups})
    adaptive.run_adaptively(config, tmp_path, "simd")
    told = words.list_runs(tmp_path, manifest.read_manifest(tmp_path))
    assert (told["runs"], told["rows"], told["columns"]["group"]) == (6, 2, ["free", "timed"])
    assert told["columns"]["start_ms"][1] == 20
    assert (told["evading"]["n"], told["evading"]["k"]) == (1, 0)  # encoders rest before the pedal
    assert math.isnan(told["evading"]["low"]), "faults that were chosen have no interval"
