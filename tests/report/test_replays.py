"""Traces of runs, written by the store and read for the page."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.document.chart import Curve
from ravenjax.report.data import facts as run_facts
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import paths
from ravenjax.store.logs.trace import log

TICKS = 1500
FRAME = synthetic.frame(60)
FACTS = run_facts.derive(FRAME)
RUNS = Runs.of(FRAME, synthetic.manifest(len(FRAME)))
FAR = FRAME[["unintended_mm", "loss_mm"]].max(axis=1).astype("float32")
WORST = FRAME.loc[FAR[FACTS["faulty"]].nlargest(3).index]


def series(reach_mm, arms=("gold",), golden=False):
    time = np.arange(TICKS)
    out = {"runlevel": np.full(TICKS, 3)}
    for number, arm in enumerate(arms):
        model = np.stack(
            [0.01 * np.sin(time / 300), 0.02 * np.cos(time / 200), 1e-6 * time], axis=1
        )
        off = np.zeros((TICKS, 3))
        off[700:, 1] = 1e-3 * reach_mm * (number + 1) * np.minimum(1, (time[700:] - 700) / 300)
        out |= {f"{arm}/model_position": model, f"{arm}/position": model, f"{arm}/tip": model + off}
        if golden:
            out[f"{arm}/golden_tip"] = model
    return out


def folder_with(tmp_path, rows, **options):
    (tmp_path / "traces").mkdir(exist_ok=True)
    for reach, run_id in enumerate(rows["run_id"], start=4):
        log.write(tmp_path / "traces" / f"{run_id}.mcap", series(reach, **options))
    return tmp_path


def test_what_was_written_is_read(tmp_path):
    folder = folder_with(tmp_path, WORST.head(1), golden=True)
    told = paths.read(folder / "traces" / f"{WORST['run_id'].iloc[0]}.mcap")
    written = series(4, golden=True)
    np.testing.assert_array_equal(told["gold/tip"], written["gold/tip"])
    np.testing.assert_array_equal(told["gold/model"], written["gold/model_position"])
    np.testing.assert_array_equal(told["gold/golden"], written["gold/golden_tip"])
    assert told["time_ms"].tolist() == list(range(TICKS))


def test_the_worst_come_first_and_are_thinned(tmp_path):
    found, broken = paths.find(folder_with(tmp_path, WORST), RUNS)
    assert broken == [] and [one.run_id for one in found] == WORST["run_id"].tolist()
    one = found[0]
    assert len(one.time_ms) <= paths.POINTS + len(paths.MARKS) + 1
    assert one.time_ms[0] == 0 and one.time_ms[-1] == TICKS - 1
    assert one.deviation_mm.max() == pytest.approx(4.0) and one.paths["true tip"][0].tolist() == [
        0,
        0,
        0,
    ]
    assert set(one.paths) == {"true tip", "nominal model"}


def test_marks_stand_at_their_times(tmp_path):
    found, _ = paths.find(folder_with(tmp_path, WORST), RUNS)
    for one, index in zip(found, WORST.index, strict=True):
        for label, column in paths.MARKS.items():
            ms = FACTS.at[index, column]
            if 0 <= ms < TICKS:
                assert one.time_ms[one.marks[label]] == ms
            else:
                assert label not in one.marks


def test_the_arm_that_went_farther(tmp_path):
    found, _ = paths.find(folder_with(tmp_path, WORST.head(1), arms=("gold", "green")), RUNS)
    assert found[0].arm == "green" and found[0].deviation_mm.max() == pytest.approx(8.0)


def test_damaged_and_foreign_files_are_named(tmp_path):
    folder = folder_with(tmp_path, WORST)
    one, two, three = (folder / "traces" / f"{run_id}.mcap" for run_id in WORST["run_id"])
    one.write_bytes(one.read_bytes()[:5000])
    two.write_bytes(b"no mcap at all")
    log.write(three, {"gold/position": np.zeros((5, 3))})
    (folder / "traces" / "unknown.mcap").write_bytes(b"of another campaign")
    found, broken = paths.find(folder, RUNS)
    assert found == [] and [name.partition(":")[0] for name in broken] == [
        one.name,
        two.name,
        three.name,
    ]


def test_without_traces_there_is_nothing(tmp_path):
    assert paths.find(tmp_path, RUNS) == ([], [])


def test_figure_and_course(tmp_path):
    (one,), _ = paths.find(folder_with(tmp_path, WORST.head(1), golden=True), RUNS)
    chart = paths.distance(one)
    np.testing.assert_array_equal(chart.marks[0].x, one.time_ms)
    np.testing.assert_array_equal(chart.marks[0].y, one.deviation_mm)
    assert {mark.name: mark.x[0] for mark in chart.marks[1:]} == {
        f"{label} {one.time_ms[point]:,} ms": one.time_ms[point]
        for label, point in one.marks.items()
    }
    course = paths.course(one)
    assert len({len(course[name]) for name in ("time", "tip", "model", "off")}) == 1
    assert max(course["off"]) == pytest.approx(4.0)


def test_views_are_at_one_scale_and_marks_stand_where_the_tip_is(tmp_path):
    (one,), _ = paths.find(folder_with(tmp_path, WORST.head(1), golden=True), RUNS)
    views = paths.views(one)
    spans = [axis.high - axis.low for view in views for axis in (view.x, view.y)]
    assert spans == pytest.approx([spans[0]] * 6)
    for (across, up), view in zip(paths.VIEWS, views, strict=True):
        curves = {mark.name: mark for mark in view.marks if isinstance(mark, Curve)}
        assert set(curves) == {"true tip", "nominal model", "golden run"}
        for name, path in one.paths.items():
            np.testing.assert_array_equal(curves[name].x, path[:, across])
            np.testing.assert_array_equal(curves[name].y, path[:, up])
        assert "mm off" in view.words()
