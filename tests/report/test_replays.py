"""Traces of runs, written by the store and read for the page."""

from __future__ import annotations

import json

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report import facts as run_facts
from ravenjax.report import replay_figure, replays
from ravenjax.report.runs import Runs
from ravenjax.store import trace_log

TICKS = 1500
FRAME = synthetic.frame(60)
FACTS = run_facts.derive(FRAME)
RUNS = Runs.of(FRAME, synthetic.manifest(len(FRAME)))
WORST = FRAME.loc[FACTS["faulty"]].nlargest(3, "peak_live_deviation_mm")


def series(reach_mm, arms=("gold",), twin=False):
    time = np.arange(TICKS)
    out = {"runlevel": np.full(TICKS, 3)}
    for number, arm in enumerate(arms):
        model = np.stack([0.01 * np.sin(time / 300), 0.02 * np.cos(time / 200), 1e-6 * time], axis=1)
        off = np.zeros((TICKS, 3))
        off[700:, 1] = 1e-3 * reach_mm * (number + 1) * np.minimum(1, (time[700:] - 700) / 300)
        out |= {f"{arm}/model_position": model, f"{arm}/position": model, f"{arm}/tip": model + off}
        if twin:
            out[f"{arm}/twin_tip"] = model
    return out


def folder_with(tmp_path, rows, **options):
    (tmp_path / "traces").mkdir(exist_ok=True)
    for reach, run_id in enumerate(rows["run_id"], start=4):
        trace_log.write(tmp_path / "traces" / f"{run_id}.mcap", series(reach, **options))
    return tmp_path


def test_what_was_written_is_read(tmp_path):
    folder = folder_with(tmp_path, WORST.head(1), twin=True)
    told = replays.read(folder / "traces" / f"{WORST['run_id'].iloc[0]}.mcap")
    written = series(4, twin=True)
    np.testing.assert_array_equal(told["gold/tip"], written["gold/tip"])
    np.testing.assert_array_equal(told["gold/model"], written["gold/model_position"])
    np.testing.assert_array_equal(told["gold/twin"], written["gold/twin_tip"])
    assert told["time_ms"].tolist() == list(range(TICKS))


def test_the_worst_come_first_and_are_thinned(tmp_path):
    found, broken = replays.find(folder_with(tmp_path, WORST), RUNS)
    assert broken == [] and [one.run_id for one in found] == WORST["run_id"].tolist()
    one = found[0]
    assert len(one.time_ms) <= replays.POINTS + len(replays.MARKS) + 1
    assert one.time_ms[0] == 0 and one.time_ms[-1] == TICKS - 1
    assert one.deviation_mm.max() == pytest.approx(4.0) and one.paths["true tip"][0].tolist() == [0, 0, 0]
    assert set(one.paths) == {"true tip", "nominal model"}


def test_marks_stand_at_their_times(tmp_path):
    found, _ = replays.find(folder_with(tmp_path, WORST), RUNS)
    for one, index in zip(found, WORST.index, strict=True):
        for label, column in replays.MARKS.items():
            ms = FACTS.at[index, column]
            if 0 <= ms < TICKS:
                assert one.time_ms[one.marks[label]] == ms
            else:
                assert label not in one.marks


def test_the_arm_that_went_farther(tmp_path):
    found, _ = replays.find(folder_with(tmp_path, WORST.head(1), arms=("gold", "green")), RUNS)
    assert found[0].arm == "green" and found[0].deviation_mm.max() == pytest.approx(8.0)


def test_damaged_and_foreign_files_are_named(tmp_path):
    folder = folder_with(tmp_path, WORST)
    one, two, three = (folder / "traces" / f"{run_id}.mcap" for run_id in WORST["run_id"])
    one.write_bytes(one.read_bytes()[:5000])
    two.write_bytes(b"no mcap at all")
    trace_log.write(three, {"gold/position": np.zeros((5, 3))})
    (folder / "traces" / "unknown.mcap").write_bytes(b"of another campaign")
    found, broken = replays.find(folder, RUNS)
    assert found == [] and [name.partition(":")[0] for name in broken] == [one.name, two.name, three.name]


def test_without_traces_there_is_nothing(tmp_path):
    assert replays.find(tmp_path, RUNS) == ([], [])


def test_figure_and_course(tmp_path):
    import plotly.graph_objects as go

    (one,), _ = replays.find(folder_with(tmp_path, WORST.head(1), twin=True), RUNS)
    figure = go.Figure(json.loads(replay_figure.path(one)))
    assert [trace.name for trace in figure.data[:3]] == ["instrument", "nominal model", "fault-free twin"]
    assert [trace.name for trace in figure.data[-2:]] == ["instrument now", "model now"]
    course = replay_figure.course(one)
    assert len({len(course[name]) for name in ("time", "tip", "model", "off")}) == 1
    assert max(course["off"]) == pytest.approx(4.0)
