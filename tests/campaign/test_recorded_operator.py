"""A recorded operator in a campaign: its keys, what the robot then does, and that all of it is
said.
"""

import numpy as np
import pandas as pd
import pytest

import ravenjax as rj
from ravenjax.campaign import loading, notices, plan, runner
from ravenjax.engines import selection
from ravenjax.errors import UserError
from ravenjax.robots.raven2.campaign.hands import operator_bounds
from ravenjax.robots.raven2.geometry import limits
from ravenjax.store import manifest
from ravenjax.store.motion.summary import table_rows

HOME_MM = np.array([-77.946997893, -25.265555299, 13.225627957])  # gold's tip at home, frame 0


@pytest.fixture
def hands(tmp_path):
    """Three seconds along a circle of 8 mm about the home tip, 100 rows a second."""
    time_s = np.arange(300) / 100.0
    phase = 2.0 * np.pi * time_s / 3.0
    place = HOME_MM + np.stack(
        [4.0 * (1.0 - np.cos(phase)), 4.0 * np.sin(phase), 0.0 * phase], axis=1
    )
    path = tmp_path / "hands.csv"
    pd.DataFrame(
        {"t_ms": time_s * 1e3} | {f"gold_{a}_mm": place[:, i] for i, a in enumerate("xyz")}
    ).to_csv(path, index=False)
    return path


def tables(file, **more):
    return {
        "campaign": {"name": "hands", "duration_s": 2.0},
        "operator": {"file": str(file), **more},
        "group": [{"name": "free"}],
    }


@pytest.mark.parametrize(
    ("operator", "says"),
    [
        (
            {"motion": "reach", "rate_hz": 1000},
            "rate_hz is for recorded motions only, but the motion is generated: remove",
        ),
        (
            {"file": "a.csv", "seed": 3},
            "seed is for generated motions only, but the motion is recorded: remove",
        ),
        ({"file": "a.csv", "spikes": "drop"}, "expected 'refuse', 'remove' or 'replay'"),
        ({"file": "a.csv", "rate_hz": 0}, "operator.rate_hz: got 0"),
    ],
)
def test_keys_that_do_not_fit(operator, says):
    raw = {"campaign": {"name": "x"}, "operator": operator, "group": [{"name": "g"}]}
    with pytest.raises(UserError, match="operator") as error:
        loading.from_dict(raw)
    assert says in str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [0.1, 0.5])
def test_the_robot_is_sent_where_the_tip_was_recorded(hands, scale):
    """Through packets of whole micrometres, increments and accumulator, at any scale."""
    config = rj.load_campaign(tables(hands, scale=scale))
    series = rj.simulate(config, 0, "simd")
    recorded = pd.read_csv(hands)[["gold_x_mm", "gold_y_mm", "gold_z_mm"]].to_numpy()
    ticks = 749 + 10 * np.arange(30, 110)  # of these samples, in the campaign
    wanted = recorded[30:110] - recorded[0]
    sent = series["position_d"].sel(arm="gold").to_numpy() * 1e3
    moved = sent[ticks] - sent[400]
    assert np.abs(moved - wanted).max() < 0.05  # mm; a tick or two later
    assert np.ptp(wanted, axis=0).max() > 4.0


def test_limits_are_those_of_the_campaign(hands):
    config = loading.from_dict(tables(hands), overrides=["limits.insertion_m=[0.3, 0.402]"])
    bounds = operator_bounds(config)
    assert (bounds.lower[2], bounds.upper[2]) == (0.3, 0.402)
    with pytest.raises(
        UserError, match=r"insertion of gold would be at 40\d.* within 302.00 to 400.00 mm"
    ):
        plan.make_plan(config)
    fork = loading.from_dict(tables(hands), overrides=["campaign.software=fork2015"])
    assert operator_bounds(fork).upper[3] == pytest.approx(limits.FORK_ROLL_LIMIT)


def test_jaws_beyond_the_limits_of_the_software_are_noted(hands):
    """From 90 to 120 degrees and back; gain 2 of the fork doubles what is recorded."""
    opening = 90.0 + 30.0 * np.sin(np.pi * np.arange(300) / 100.0)
    pd.read_csv(hands).assign(gold_grasp_deg=opening).to_csv(hands, index=False)

    def said(**campaign):
        raw = tables(hands)
        raw["campaign"] |= campaign
        return " ".join(notices.of_plan(plan.make_plan(rj.load_campaign(raw))))

    assert "of 1,800 samples open the jaws of gold beyond" in said()
    assert "-0.174 to 1.570 rad, by up to 0.524 rad" in said()
    assert "-0.523 to 1.570 rad, by up to 1.047 rad" in said(software="fork2015")
    assert said(console="absolute") == ""


@pytest.mark.slow
def test_the_manifest_keeps_what_became_of_it(hands, tmp_path):
    raw = tables(hands, cutoff_hz=5.0)
    rj.run(rj.load_campaign(raw), tmp_path / "out", engine="simd")
    record = manifest.read_manifest(tmp_path / "out")
    summary = record.operator
    assert summary is not None and summary == plan.make_plan(rj.load_campaign(raw)).operator
    assert (summary.clock, summary.rows, summary.options.cutoff_hz) == ("column t_ms", 300, 5.0)
    assert summary.window_s == (0.0, 1.25) and summary.rate_hz == pytest.approx(100.0)
    assert summary.arms[0].removed[0] < 0.05
    rows = dict(table_rows(summary))
    assert (
        "column t_ms: 100 rows per second (every 10 ms), 2.990 s in total; interpolated by time"
        in rows["time"]
    )
    assert "0.000 to 1.250 s of the recording" in rows["replayed"]
    rj.run(rj.load_campaign(raw), tmp_path / "out", engine="simd")  # done: the same again
    assert manifest.read_manifest(tmp_path / "out").operator == summary


def test_a_campaign_does_not_depend_on_where_its_recording_lies(hands, tmp_path):
    elsewhere, changed = tmp_path / "elsewhere" / "same.csv", tmp_path / "changed.csv"
    elsewhere.parent.mkdir()
    elsewhere.write_bytes(hands.read_bytes())
    changed.write_text(hands.read_text().replace("-77.9", "-77.8"))
    plans = [plan.make_plan(rj.load_campaign(tables(file))) for file in (hands, elsewhere, changed)]
    engine = selection.select_engine("xla", plans[0].program.setup.precision)
    records = [runner.make_manifest(one, engine) for one in plans]
    assert records[0].config["operator"]["file"] != records[1].config["operator"]["file"]
    assert records[0].config_hash == records[1].config_hash != records[2].config_hash
    assert records[0].differences(records[1]) == []
    assert any(
        line.startswith("config.operator.file: ") for line in records[0].differences(records[2])
    )
