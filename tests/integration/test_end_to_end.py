"""From a campaign file to report and trace by the command line alone; a second start has nothing
to do.
"""

import json

import numpy as np
import pandas as pd
import pytest
import ros2_log

from ravenjax.cli import main
from ravenjax.store.folder import read_all

CAMPAIGN = """
[campaign]
name = "tiny"
duration_s = 0.4
chunk = 2

[operator]
motion = "reach"

[[group]]
name = "free"

[[group]]
name = "burst"
[[group.fault]]
site = "usb_out"
channel = "shoulder"
effect = "overwrite"
value = [-9000, 0, 9000]
start_ms = 250
duration_ms = [5, 40]
"""
RUNS = 7


def call(*tokens):
    """Exit code of a command line."""
    return main([str(token) for token in tokens])


@pytest.fixture(scope="module")
def out(tmp_path_factory):
    """The result folder after one run."""
    folder = tmp_path_factory.mktemp("end_to_end")
    (folder / "tiny.toml").write_text(CAMPAIGN)
    assert call("run", folder / "tiny.toml", "--out", folder / "out", "--engine", "simd") == 0
    return folder / "out"


def test_the_table_holds_every_run(out):
    frame = read_all(out)
    assert len(frame) == RUNS and frame["run_id"].is_unique
    assert (frame["failed"] == "").all()
    assert len(list((out / "parts").iterdir())) == 4
    hit = frame[frame["fault0_value"].abs() == 9000]
    assert (hit["active_ticks"] == hit["fault0_duration_ms"]).all()
    assert hit["diverged"].all() and (hit["peak_dac_gold_shoulder"] >= 9000).all()


@pytest.fixture(scope="module")
def traced(out):
    """Row and files of one run."""
    frame = read_all(out)
    row = frame[(frame["fault0_value"] == 9000) & (frame["fault0_duration_ms"] == 40)].iloc[0]
    assert call("trace", out, row["run_id"][:10]) == 0
    return row, {
        kind: out / "traces" / f"{row['run_id']}.{kind}" for kind in ("mcap", "csv", "svg")
    }


@pytest.mark.slow
def test_a_trace_is_a_log_of_every_millisecond(traced):
    row, files = traced
    log = ros2_log.read(files["mcap"])
    every_ms = (
        "measured_js",
        "setpoint_js",
        "true_js",
        "model_js",
        "measured_cp",
        "true_cp",
        "model_cp",
        "golden_tip",
    )
    for topic in ("/tf", "/ravenjax/signals", *(f"/arm1/{name}" for name in every_ms)):
        assert [message.number for message in log.topics[topic]] == list(range(400)), topic
    for topic in ("measured_cp", "setpoint_cp", "true_cp", "model_cp"):
        quaternion = log.column(f"/arm1/{topic}", "pose", "orientation")
        np.testing.assert_allclose(np.linalg.norm(quaternion, axis=1), 1.0, atol=1e-9)
    true, model = (log.column(f"/arm1/{name}_cp", "pose", "position") for name in ("true", "model"))
    assert 1e3 * np.linalg.norm(true - model, axis=1).max() == pytest.approx(
        row["peak_model_deviation_mm"], rel=1e-3
    )
    told = log.metadata["ravenjax"]
    record = json.loads((files["mcap"].parents[1] / "manifest.json").read_text())
    assert (
        told["run_id"] == row["run_id"]
        and told["campaign"] == "tiny"
        and told["seed"] == str(row["seed"])
    )
    assert told["fault"] == "usb_out gold shoulder, overwrite 9,000 counts, 40 ms from 250 ms"
    assert (
        told["fault0_site"] == "usb_out"
        and told["code_hash"] == told["campaign_code_hash"] == record["code_hash"]
    )
    assert told["engine"].startswith("simd on ") and told["version"] == "0.1.0"


def test_events_of_a_trace_are_what_the_row_says(traced):
    row, files = traced
    log = ros2_log.read(files["mcap"])
    told = [json.loads(message.value.data) for message in log.topics["/ravenjax/events"]]
    assert told == sorted(told, key=lambda event: event["tick"])
    fault = [event for event in told if event["kind"] == "fault"]
    _, first, last = fault
    assert first["tick"] == row["first_active_ms"] == 250
    assert "overwrite 9,000 counts" in first["text"]
    assert last["tick"] == row["applied0_last_ms"] == 289
    for name in ("check_overdrive_clip", "cue0", "unintended"):
        kind = {"check_overdrive_clip": "check", "cue0": "cue", "unintended": "hazard"}[name]
        times = [event["tick"] for event in told if event["kind"] == kind]
        assert row[f"{name}_first_ms"] in (-1, *times), name
    assert [message.value.msg for message in log.topics["/ravenjax/log"]] == [
        event["text"] for event in told
    ]


def test_a_trace_is_a_table_and_a_plot(traced):
    row, files = traced
    assert files["svg"].read_text(encoding="utf-8").rstrip().endswith("</svg>")
    table = pd.read_csv(files["csv"])
    assert table["time_s"].iloc[-1] == 0.399
    dac = table["gold/dac_cnt/shoulder [counts]"]
    assert (dac[250:290] == 9000).all() and dac.abs().max() == row["peak_dac_gold_shoulder"]


def test_the_notebook_sees_the_same_series(out, traced):
    import ravenjax as rj

    row, _ = traced
    found = rj.simulate(out.parent / "tiny.toml", row["run_id"], engine="simd")
    assert dict(found.sizes) == {
        "time": 400,
        "arm": 1,
        "joint": 7,
        "axis": 3,
        "jaw_axis": 3,
        "fault": 1,
        "cue": 1,
    }
    assert found.attrs["verdict"] == row["verdict"] and found.attrs["run_id"] == row["run_id"]
    gold = found.sel(arm="gold")
    assert np.abs(gold["dac_cnt"].sel(joint="shoulder", time=slice(0.25, 0.289))).min() >= 9000
    assert found["fault_active"].sel(fault=0).values.nonzero()[0].tolist() == list(range(250, 290))
    for other, column in (
        ("golden_tip", "peak_golden_deviation_mm"),
        ("model_position", "peak_model_deviation_mm"),
    ):
        far = np.linalg.norm(gold["tip"] - gold[other], axis=1).max() * 1e3
        assert far == pytest.approx(row[column], rel=1e-3)
    assert found["jpos"].attrs["units"] == "rad" and found["jpos"].attrs["insertion_units"] == "m"
    assert (
        found["cue_threshold_mm"].values.tolist() == [3.0] and found["time"].attrs["units"] == "s"
    )


def test_what_a_run_gave_as_json(out, capsys):
    assert call("run", out.parent / "tiny.toml", "--out", out, "--engine", "simd", "--json") == 0
    printed = capsys.readouterr()
    told = json.loads(printed.out)
    frame = read_all(out)
    acted = frame[(frame["fault0_site"] != "") & frame["activated"] & (frame["verdict"] != "")]
    faults = acted.drop_duplicates([name for name in frame if name.startswith("fault0_")])
    verdicts = faults["verdict"].value_counts()
    assert told["verdicts_of_distinct_faults"] == verdicts[verdicts > 0].to_dict()
    assert told["runs_not_counted"]["repeats"] == len(acted) - len(faults)
    assert (told["folder"], told["report"], told["shard"]) == (
        str(out),
        str(out / "report.html"),
        None,
    )
    assert told["runs"] == told["finished"] == RUNS and told["engine"] == "simd"
    assert "7 of 7 runs" in printed.err
