"""Findings do not depend on who runs them: what needs a recording stands apart, all the rest is
the same.
"""

from __future__ import annotations

import dataclasses
import json
from pathlib import Path

import numpy as np
import pytest
from made_up_runs import VALUES, runs_of
from matplotlib.figure import Figure

from ravenjax.bundled import resources
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from studies import catalogue
from studies.dsn16 import (
    detection,
    model,
    motor_commands,
    operator_packets,
    thresholds,
    timing,
    trajectory,
)
from studies.dsn16 import runs as dsn16_runs
from studies.dsn16.cells import DURATIONS
from studies.dsn16.detection import Watched
from studies.dsn16.detector import RunAlarms
from studies.dsn16.recording import closed_loop, horizons
from studies.dsn16.runs import VariantRuns
from studies.dsn16.thresholds import FaultFree
from studies.framework import targets
from studies.framework.study import Context, Findings, plain
from studies.mechanics import recordings
from studies.mechanics import robot as mechanics

STUDIES = {"dsn16_a": operator_packets, "dsn16_b": motor_commands, "dsn16_thresholds": thresholds}
"""Those that add windows of a recorded operator where it is at hand."""

SOURCES = Path(catalogue.__file__).parent
REFERENCE = resources.bundled("campaigns", "quick.toml")[0].parents[1] / "results/reference"
PLAIN = runs_of({(10000, d): 10 for d in (16, 32, 64, 128)})
WILD = runs_of({(value, d): 9 for value in VALUES for d in DURATIONS})

JUMP = np.array(HOME_JPOS) + np.array([[0.0], [0.01], [0.02]]) * np.eye(7)[0]
"""The shoulder turns by 0.01 rad from packet to packet."""


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """A folder that has the name of each recording; what is in them is never read here."""
    for name in (trajectory.RECORDING, closed_loop.FILE):
        (tmp_path / name).touch()
    return tmp_path


@pytest.fixture(autouse=True)
def made_up_series(monkeypatch: pytest.MonkeyPatch) -> None:
    """Runs and their series as they are wherever nothing is recorded, and far from it for
    recorded hands.
    """

    def read(name: str, folder: Path) -> VariantRuns:
        return dataclasses.replace(WILD if name.startswith("recorded") else PLAIN, name=name)

    def watch(folder: Path, runs: VariantRuns, levels: dict[str, np.ndarray]) -> Watched:
        alarms = [
            RunAlarms((bool(jump),) * 4, (bool(jump),) * 4, 1 if jump else -1)
            for jump in runs.hits["jump"]
        ]
        joints = np.where(runs.hits["jump"][:, None, None], JUMP, np.nan)
        return Watched(
            levels,
            dict.fromkeys(levels, alarms),
            np.ones(len(alarms)),
            np.zeros(len(alarms), bool),
            joints,
        )

    def measure(folder: Path, measured: object) -> list[FaultFree]:
        rng = np.random.default_rng(len(folder.name))
        size = 1e3 if folder.name.startswith("recorded") else 1.0
        steps, tips = rng.random((3, 40, 3, 3)), rng.random((3, 40, 3))
        return [
            FaultFree(size * s, size * t, s[0, 0], t[0], (0.1, 0.2))
            for s, t in zip(steps, tips, strict=True)
        ]

    monkeypatch.setattr(dsn16_runs, "read", read)
    monkeypatch.setattr(detection, "learn", lambda folders: None)
    monkeypatch.setattr(
        detection, "thresholds", lambda learned: {detection.CHOSEN: np.ones((3, 3))}
    )
    monkeypatch.setattr(detection, "watch", watch)
    monkeypatch.setattr(thresholds, "measure", measure)


def findings(name: str, data: Path | None, monkeypatch: pytest.MonkeyPatch) -> Findings:
    """Of a study whose user has the recordings in folder `data`, or has none."""
    if data is None:
        monkeypatch.delenv(trajectory.DATA, raising=False)
    else:
        monkeypatch.setenv(trajectory.DATA, str(data))
    return STUDIES[name].compare(
        Context({variant.name: Path(variant.name) for variant in STUDIES[name].variants()})
    )


def rest(found: Findings) -> Findings:
    """Everything but what says of itself that it is of recorded hands."""
    return Findings(
        found.lines,
        tuple(table for table in found.tables if not table.title.startswith(trajectory.HANDS)),
        found.drawings,
        tuple(note for note in found.notes if not note.startswith(trajectory.HANDS)),
    )


def curves(found: Findings) -> list[tuple[str, object, list[list[float]]]]:
    """Every labelled line of every drawing."""
    result = []
    for drawing in found.drawings:
        figure = Figure()
        drawing.draw(figure)
        for axis in figure.axes:
            result += [
                (drawing.name, line.get_label(), np.asarray(line.get_xydata()).tolist())
                for line in axis.lines
            ]
    return result


@pytest.mark.parametrize("name", STUDIES)
def test_recorded_hands_change_nothing_but_their_own_tables(name, recording, monkeypatch):
    without, beside = (findings(name, data, monkeypatch) for data in (None, recording))
    assert plain(rest(beside)) == plain(rest(without))
    assert curves(beside) == curves(without)
    states = [targets.states(plain(found)["lines"]) for found in (without, beside)]
    assert states[0] == states[1]


@pytest.mark.parametrize("name", STUDIES)
def test_recorded_hands_stand_in_tables_of_their_own_and_a_note_says_what_they_need(
    name, recording, monkeypatch
):
    without, beside = (findings(name, data, monkeypatch) for data in (None, recording))
    tables = [table for table in beside.tables if table.title.startswith(trajectory.HANDS)]
    windows = set(trajectory.recorded())
    assert len(windows) == 4 and tables
    assert all(windows <= {row[0] for row in table.rows} for table in tables)
    assert not any(table.title.startswith(trajectory.HANDS) for table in without.tables)
    (note,) = (note for note in without.notes if note.startswith(trajectory.HANDS))
    assert trajectory.DATA in note and trajectory.RECORDING in note
    assert str(recording) not in str(plain(beside))


@pytest.mark.parametrize("name", STUDIES)
def test_recorded_hands_stand_apart_in_the_findings_that_are_kept(name):
    record = json.loads((REFERENCE / name / "findings.json").read_text(encoding="utf-8"))
    others = [
        table for table in record["tables"] if not table["title"].startswith(trajectory.HANDS)
    ]
    assert not any(
        "recorded_" in str(part)
        for part in (record["lines"], record["drawings"], record["notes"], others)
    )


def test_a1_is_judged_by_the_baseline_alone(recording, monkeypatch):
    found = findings("dsn16_b", recording, monkeypatch)
    judged = [line for line in found.lines if line.target == "A1"]
    assert found.lines[: len(judged)] == tuple(judged) and len(judged) == len(DURATIONS) + 1
    assert all(motor_commands.BASELINE in line.quantity for line in judged)
    others = [
        line
        for line in found.lines
        if line.band and line not in judged and "suture" in line.quantity
    ]
    assert len(others) == len(trajectory.LEVERS) * (len(DURATIONS) + 1)
    first = [
        line for line in found.lines if line.quantity.split("; ")[-1].startswith(timing.DECLARED)
    ]
    assert len(first) == len(DURATIONS) + 1 and not any(line.target for line in first)


def test_without_its_recording_a_target_has_the_same_lines_and_is_not_judged(
    recording, monkeypatch
):
    """A3 compares with a recording and with nothing else: there is no prediction without it."""
    error = model.Error(np.full(3, 0.5), np.full(3, 0.6))
    models = (
        *(
            (loop, one)
            for loop in (horizons.CLOSED, horizons.OPEN)
            for one in ("virtual robot", horizons.ROTORS)
        ),
    )
    nulls = ((horizons.NO_LOOP, one) for one in (horizons.HELD_POSITION, horizons.HELD_VELOCITY))
    ahead = [
        horizons.HorizonError(loop, one, horizon, *error)
        for loop, one in (*models, *nulls)
        for horizon in (*horizons.HORIZONS_MS, None)
    ]
    log = closed_loop.JointRecording(*(np.zeros((400, 3)) for _ in range(3)))
    monkeypatch.setattr(closed_loop, "read", lambda path: log)
    monkeypatch.setattr(model, "error", lambda *given: error)
    monkeypatch.setattr(horizons, "compare", lambda part, models: ahead)
    monkeypatch.setenv(trajectory.DATA, str(recording))
    beside = model.compare(Context({})).lines
    monkeypatch.delenv(trajectory.DATA)
    without = model.compare(Context({})).lines
    assert [dataclasses.replace(line, predicted=None, reason="") for line in beside] == [
        dataclasses.replace(line, reason="") for line in without
    ]
    assert [
        targets.sentence(state) for state in targets.states(plain(Findings(beside))["lines"])
    ] == ["A3 met: 3 of 3 lines inside their band"]
    assert [
        targets.sentence(state) for state in targets.states(plain(Findings(without))["lines"])
    ] == ["A3 not judged: no line of it with a band has a prediction"]


def test_every_study_that_asks_for_recordings_is_tested_here():
    asks = {
        path
        for path in SOURCES.rglob("*.py")
        if trajectory.DATA in path.read_text(encoding="utf-8")
    }
    assert asks == {Path(str(one.__file__)) for one in (trajectory, closed_loop, recordings)}
    assert (
        not mechanics.STUDY.targets
    )  # without its recordings it has no line, which its own tests hold
    uses = {
        path
        for path in SOURCES.rglob("*.py")
        if "trajectory.recorded(" in path.read_text(encoding="utf-8")
    }
    assert uses == {Path(str(module.__file__)) for module in STUDIES.values()}
    uses = {
        path
        for path in SOURCES.rglob("*.py")
        if "closed_loop.find(" in path.read_text(encoding="utf-8")
    }
    assert uses == {Path(str(model.__file__))}
