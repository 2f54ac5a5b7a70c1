"""Tip paths of the worst runs that were traced: read from the folder's MCAP files, thinned for a
page; seen along each axis at one scale, and how far the tip was off the model over time.

`ravenjax trace` writes one file a run into traces/; those that are there are shown. A file that
cannot be read is named on the page and left out: it is no part of the result.
"""

from __future__ import annotations

import json
import re
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax import robots
from ravenjax.document import palette
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots, Mark
from ravenjax.report import wording
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import Section
from ravenjax.store.access.query import RESULTS
from ravenjax.store.logs import topics
from ravenjax.vocabulary.robot import Robot

FOLDER = "traces"
MOST = 6
POINTS = 300
"""Of each path: a tip that is drawn every 10 ms of 3 s."""
SIGNALS = "/ravenjax/signals"
_MODEL = {"model_cp": 7, "model_tip": 3}
"""Topics of an arm that hold the nominal model's tip, with or without orientation, and numbers
of a message.
"""
_TIPS = {"tip": "tip", "golden": "golden_tip"}
"""Tips among the signals."""
MARKS = {
    "first effect": "active_ms",
    "cue": "cue_ms",
    "response": "response_ms",
    "unintended motion": "unintended_ms",
    "loss of motion": "loss_ms",
}
"""What is marked on a path, and the column of facts that says when."""


HEIGHT = 240
"""Of one view, px."""
COLOURS = {
    "first effect": palette.SAME,
    "cue": palette.CUE,
    "response": palette.RESPONSE,
    "unintended motion": "series3",
    "loss of motion": "series4",
}
PATH_COLOURS = {"true tip": palette.CUE, "nominal model": palette.SAME, "golden run": "series2"}
VIEWS = ((0, 1), (0, 2), (1, 2))
"""Axes along and upwards."""
LEAST_MM = 1.0
"""A path that hardly moves is drawn at this scale."""


class TracedRun(NamedTuple):
    """One traced run. Paths are [points, 3] in mm about the first point of the true tip, frame 0
    of the arm.
    """

    run_id: str
    arm: str  # the one whose tip went farthest from the model
    title: str  # group and fault in words
    time_ms: np.ndarray  # [points]
    paths: dict[str, np.ndarray]  # "true tip", "nominal model", "golden run" where the trace has it
    deviation_mm: np.ndarray  # [points], true tip from the model
    marks: dict[str, int]  # label -> index of the point


def find(folder: Path, runs: Runs) -> tuple[list[TracedRun], list[str]]:
    """The MOST worst traced runs, the farthest from the model first; and the files that could
    not be read.
    """
    traced = {path.stem: path for path in sorted((folder / FOLDER).glob("*.mcap"))}
    replays, broken = [], []
    for row in runs.numbered(_worst(runs, list(traced))):
        path = traced[row["run_id"]]
        try:
            replays.append(_replay(runs.robot, row, read(path, runs.robot)))
        except (OSError, ValueError, KeyError, struct.error, *_damage()) as error:
            broken.append(f"{path.name}: {error or type(error).__name__}")
    return replays, broken


def _worst(runs: Runs, run_ids: list[str]) -> list[int]:
    if not run_ids:
        return []
    far = "greatest(unintended_mm, loss_mm)"
    rows = runs.table.rows(
        f"SELECT row FROM {RESULTS} WHERE run_id IN (SELECT unnest(?)) ORDER BY isnan({far}), {far}"
        f" DESC, row LIMIT {MOST}",
        [run_ids],
    )
    return [row for (row,) in rows]


def read(path: Path, robot: Robot = robots.USUAL) -> dict[str, np.ndarray]:
    """Tips of a trace as it names them, [T, 3] in m: <arm>/tip, <arm>/model, <arm>/golden; and
    time_ms.

    Raises ValueError, KeyError or what the mcap library raises where the file is no trace of
    ravenjax.
    """
    from mcap.reader import make_reader

    models = {f"/{topics.arm_name(arm)}/{name}": arm for arm in robot.arms for name in _MODEL}
    numbers: dict[str, dict[int, bytes]] = {}
    names: list[str] = []
    with open(path, "rb") as file:
        for schema, channel, message in make_reader(file).iter_messages(topics=[SIGNALS, *models]):
            if channel.topic == SIGNALS and not names and schema is not None:
                names = re.findall(r"^float64 (\w+)$", schema.data.decode().partition("=")[0], re.M)
            width = _MODEL.get(channel.topic.rpartition("/")[2], len(names))
            numbers.setdefault(channel.topic, {})[message.sequence] = message.data[-8 * width :]
    signals = _rows(numbers[SIGNALS], len(names), len(numbers[SIGNALS]))
    out = {"time_ms": np.arange(len(signals))}
    for arm in robot.arms:
        for name, tip in _TIPS.items():
            columns = [f"{arm}_{tip}_{axis}" for axis in range(3)]
            if columns[0] in names:
                out[f"{arm}/{name}"] = signals[:, [names.index(column) for column in columns]]
    for topic, arm in models.items():
        if topic in numbers:
            width = _MODEL[topic.rpartition("/")[2]]
            out[f"{arm}/model"] = _rows(numbers[topic], width, len(signals))[:, :3]
    return out


def _rows(messages: Mapping[int, bytes], width: int, ticks: int) -> np.ndarray:
    """The doubles at the end of each little-endian CDR message, [ticks, width]; NaN in a tick
    without a message.
    """
    out = np.full((ticks, width), np.nan)
    out[list(messages)] = np.frombuffer(b"".join(messages.values()), "<f8").reshape(-1, width)
    return out


def _damage() -> tuple[type[Exception], ...]:
    """What a damaged file makes the library and its decompressors raise."""
    import zstandard
    from mcap.exceptions import McapError

    return McapError, zstandard.ZstdError, RuntimeError


def _replay(robot: Robot, row: dict[Any, Any], series: dict[str, np.ndarray]) -> TracedRun:
    arms = [arm for arm in robot.arms if f"{arm}/tip" in series and f"{arm}/model" in series]
    if not arms:
        raise ValueError("the trace holds no tip beside its model")
    distance = {
        arm: 1e3 * np.linalg.norm(series[f"{arm}/tip"] - series[f"{arm}/model"], axis=1)
        for arm in arms
    }
    arm = max(arms, key=lambda one: distance[one].max())
    ticks = len(series["time_ms"])
    events = {
        label: int(row[column]) for label, column in MARKS.items() if 0 <= row[column] < ticks
    }
    even = np.linspace(0, ticks - 1, min(POINTS, ticks)).round().astype(int)
    points = np.unique(
        np.concatenate([even, [*events.values(), int(distance[arm].argmax())]]).astype(int)
    )
    start = series[f"{arm}/tip"][0]
    named = {"true tip": "tip", "nominal model": "model", "golden run": "golden"}
    return TracedRun(
        row["run_id"],
        arm,
        f"{row['group']}: {wording.fault(row, robot)}",
        series["time_ms"][points],
        {
            name: 1e3 * (series[f"{arm}/{key}"][points] - start)
            for name, key in named.items()
            if f"{arm}/{key}" in series
        },
        distance[arm][points],
        {label: int(np.searchsorted(points, ms)) for label, ms in events.items()},
    )


def distance(replay: TracedRun) -> Chart:
    """Chart of how far the true tip was off the model, with what came when."""
    time, off = replay.time_ms.astype(float), replay.deviation_mm
    marks: list[Mark] = [Curve("true tip off the model", "series1", time, off)]
    for label, point in replay.marks.items():
        at, far = time[[point]], off[[point]]
        text = f"{label} {time[point]:,.0f} ms"
        marks.append(Dots(text, COLOURS[label], at, far, tips=(f"{text}: {off[point]:.2f} mm",)))
    most = 1.05 * max(float(off.max()), 0.1)
    end = max(float(time[-1]), 1.0)
    return Chart(
        "Off the model",
        ChartAxis("ms", 0.0, end, unit="ms"),
        ChartAxis("mm", 0.0, most, unit="mm"),
        tuple(marks),
        190,
    )


def views(replay: TracedRun) -> list[Chart]:
    """The path as seen along each axis, all at one scale."""
    everything = np.concatenate(list(replay.paths.values()))
    low, high = everything.min(axis=0), everything.max(axis=0)
    middle = (low + high) / 2
    reach = 0.55 * max(float((high - low).max()), LEAST_MM)
    tip, far = replay.paths["true tip"], int(replay.deviation_mm.argmax())
    charts = []
    for across, up in VIEWS:
        along, upwards = (
            ChartAxis(f"{'xyz'[side]}, mm", middle[side] - reach, middle[side] + reach)
            for side in (across, up)
        )
        marks: list[Mark] = [
            Curve(name, PATH_COLOURS[name], path[:, across], path[:, up], dashed=name != "true tip")
            for name, path in reversed(replay.paths.items())
        ]
        marks += [
            Dots(
                label,
                COLOURS[label],
                tip[[point], across],
                tip[[point], up],
                tips=(f"{label}, {replay.time_ms[point]:,} ms",),
            )
            for label, point in replay.marks.items()
        ]
        title = (
            f"path of the tip, at most {replay.deviation_mm[far]:.1f} mm off the nominal model, at"
            f" {replay.time_ms[far]:,} ms"
        )
        charts.append(Chart(title, along, upwards, tuple(marks), HEIGHT, equal=True))
    return charts


def course(replay: TracedRun) -> dict[str, Any]:
    """What the page's player needs: per point the time, both places and the distance, rounded."""
    return {
        "time": replay.time_ms.tolist(),
        "tip": replay.paths["true tip"].round(2).tolist(),
        "model": replay.paths["nominal model"].round(2).tolist(),
        "off": replay.deviation_mm.round(2).tolist(),
    }


def _content(runs: Runs, folder: Path) -> dict[str, Any]:
    replays, broken = find(folder, runs)
    courses = [json.dumps(course(one), allow_nan=False) for one in replays]
    return {
        "replays": replays,
        "replay_figures": [distance(one) for one in replays],
        "replay_views": [list(zip(VIEWS, views(one), strict=True)) for one in replays],
        "replay_courses": courses,
        "broken_traces": broken,
    }


SECTIONS = (Section("paths", "Paths", 160, _content),)
