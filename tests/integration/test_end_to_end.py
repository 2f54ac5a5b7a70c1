"""From a campaign file to report and trace by the command line alone; a second start has nothing to do."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from mcap.reader import make_reader

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


def test_the_report_is_one_file_that_loads_nothing(out):
    page = (out / "report.html").read_text(encoding="utf-8")
    assert "tiny" in page and "95&nbsp;%" in page
    loaded = re.findall(r"""<(?:script|img|iframe|link)\b[^>]*?\b(?:src|href)\s*=\s*["']?([^"'\s>]+)""", page)
    assert all(source.startswith(("data:", "#")) for source in loaded), loaded
    styles = "".join(re.findall(r"<style[^>]*>(.*?)</style>", page, flags=re.S))
    assert "@import" not in styles and not re.search(r"url\(\s*['\"]?http", styles)


def test_the_report_tells_how_to_replay_the_worst_run_that_no_check_noticed(out):
    frame = read_all(out)
    silent = frame[(frame["response"] == "none") & (frame["fault0_site"] != "")]
    worst = silent.loc[silent["peak_model_deviation_mm"].idxmax(), "run_id"]
    assert f"ravenjax trace {out} {worst}" in (out / "report.html").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def traced(out):
    """Row, log and plot of one run."""
    frame = read_all(out)
    row = frame[(frame["fault0_value"] == 9000) & (frame["fault0_duration_ms"] == 40)].iloc[0]
    assert call("trace", out, row["run_id"][:10]) == 0
    return row, out / "traces" / f"{row['run_id']}.mcap", out / "traces" / f"{row['run_id']}.svg"


def test_a_trace_is_a_log_and_a_plot(traced):
    row, log, plot = traced
    assert plot.read_text(encoding="utf-8").rstrip().endswith("</svg>")
    with log.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert summary is not None and summary.statistics is not None
    counts = {summary.channels[i].topic: n for i, n in summary.statistics.channel_message_counts.items()}
    assert counts["/arm1/measured_js"] == counts["/arm1/setpoint_js"] == 400, "a message a millisecond"
    assert any(row["run_id"] in entry.values() for entry in metadata.values())


def test_the_report_replays_what_was_traced_and_draws_figures(out, traced, tmp_path):
    row, _, _ = traced
    assert call("report", out, "--figures", tmp_path / "figures") == 0
    page = (out / "report.html").read_text(encoding="utf-8")
    assert row["run_id"] in page and "scatter3d" in page
    drawn = {path.suffix for path in (tmp_path / "figures").iterdir()}
    assert drawn == {".svg", ".pdf"}


def test_a_second_start_computes_nothing(out, monkeypatch):
    from ravenjax.campaign.executors import local

    before = {path: path.stat().st_mtime_ns for path in (out / "parts").iterdir()}
    table = read_all(out)
    monkeypatch.setattr(local, "Computation", None)
    assert call("run", out.parent / "tiny.toml", "--out", out, "--engine", "simd") == 0
    assert {path: path.stat().st_mtime_ns for path in (out / "parts").iterdir()} == before
    assert read_all(out).equals(table)
    record = json.loads((out / "manifest.json").read_text())
    assert record["starts"] == 2 and record["runs_per_s"] > 0.0


def test_the_notebook_sees_the_same_series(out, traced):
    import ravenjax as rj

    row, _, _ = traced
    series = rj.simulate(out.parent / "tiny.toml", row["run_id"], engine="simd")
    assert len(series["gold/tip"]) == 400
    assert np.abs(series["gold/dac_cnt"][250:290, 0]).min() >= 9000
    off_twin = np.linalg.norm(series["gold/tip"] - series["gold/twin_tip"], axis=1).max() * 1e3
    assert off_twin == pytest.approx(row["peak_twin_deviation_mm"], rel=1e-3)
    apart = np.linalg.norm(series["gold/tip"] - series["gold/model_position"], axis=1).max() * 1e3
    assert apart == pytest.approx(row["peak_model_deviation_mm"], rel=1e-3)


def test_a_limit_may_leave_only_fault_free_runs(tmp_path):
    (tmp_path / "tiny.toml").write_text(CAMPAIGN)
    assert call("run", tmp_path / "tiny.toml", "--out", tmp_path / "out", "--limit", 1, "--no-report") == 0
