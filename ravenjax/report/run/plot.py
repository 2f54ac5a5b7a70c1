"""Draws one run over time: distances of the tips, forces, commands and states."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ravenjax import robots
from ravenjax.document.chart import Chart, ChartAxis, Curve
from ravenjax.document.palette import SAME, series_colour
from ravenjax.report.drawing import save_panels
from ravenjax.store.motion.resampling import true_stretches
from ravenjax.vocabulary.robot import Robot

ARM_COLOURS = ("series5", "series2", "series0", "series3")
TIPS = {"tip": "true", "position": "as reported"}
STATES = {"runlevel": "run level", "surgeon_mode": "pedal"}
SHOWN_JOINTS = 3
"""Number of joints in the DAC panel, those with the largest peaks."""


def trace_plot(
    series: Mapping[str, np.ndarray],
    path: Path,
    *,
    title: str = "",
    threshold_mm: float = 3.0,
    cue: int = 0,
    events: Mapping[str, float] | None,
    robot: Robot = robots.USUAL,
) -> Path:
    """Draw the time series of one run at 1 kHz into `path` (.svg, .png or .pdf) and return it.

    The panels show distances of the tips from the nominal model, forces, DAC commands and states.
    series: time series by name, as for `store.logs.trace_log.write_trace`. threshold_mm, cue:
    threshold and number of the haptic set whose force is drawn. events: {label: time in ms} of
    vertical markers; negative times are left out.
    """
    seconds = np.arange(len(next(iter(series.values())))) / 1e3
    ends, limit = seconds[[0, -1]], np.full(2, threshold_mm)
    tips = [Curve(f"cue at {threshold_mm:g} mm", SAME, ends, limit, dashed=True)]
    forces, commands = [], {}
    for arm, colour in zip(robot.arms, ARM_COLOURS, strict=False):
        for name, kind in TIPS.items():
            if f"{arm}/{name}" in series and f"{arm}/model_position" in series:
                offset_mm = 1e3 * (series[f"{arm}/{name}"] - series[f"{arm}/model_position"])
                distance, dashed = np.linalg.norm(offset_mm, axis=1), name == "position"
                tips.append(Curve(f"{arm}, {kind}", colour, seconds, distance, dashed=dashed))
        if f"{arm}/cue_force" in series:
            force = series[f"{arm}/cue_force"][:, cue]
            forces.append(Curve(f"force, {arm}", colour, seconds, force, 0.0 * force, force))
        if f"{arm}/boards_cnt" in series:
            counts = series[f"{arm}/boards_cnt"].astype(float)
            largest = np.argsort(-np.abs(counts).max(axis=0), kind="stable")[:SHOWN_JOINTS]
            curves = commands[f"DAC of the {arm} arm, counts"] = []
            for joint in sorted(largest):
                name, colour = robot.joints[joint], series_colour(joint)
                curves.append(Curve(name, colour, seconds, counts[:, joint], step=True))
    panels = {
        "tip off the nominal model, mm": tips,
        "haptic force, device units": forces,
        **commands,
        "state": [
            Curve(word, series_colour(number), seconds, series[name].astype(float), step=True)
            for number, (name, word) in enumerate(STATES.items())
            if name in series
        ],
    }
    marks = [
        (f"{label}, {ms:.0f} ms", f"series{1 + number % 7}", ms / 1e3)
        for number, (label, ms) in enumerate((events or {}).items())
        if ms >= 0
    ]
    names = [name for name in series if name.startswith("fault") and "_active" in name]
    is_active = np.any([series[name] for name in names], axis=0) if names else np.zeros(0, bool)
    fault_spans = np.array(true_stretches(is_active)) / 1e3
    charts = []
    for panel, curves in panels.items():
        values = [curve.y for curve in curves if np.isfinite(curve.y).any()]
        low = min(0.0, *(float(np.nanmin(part)) for part in values), 0.0)
        high = 1.15 * max((float(np.nanmax(part)) for part in values), default=0.0) or 1.0
        height, floor, top = np.array([low, high]), np.full(2, low), np.full(2, high)
        for name, colour, s in marks:
            curves.append(Curve(name, colour, np.full(2, s), height, dashed=True))
        curves += [Curve("fault", "cue", span, floor, floor, top) for span in fault_spans]
        x_axis, y_axis = ChartAxis("time, s", 0.0, float(ends[1]) + 1e-3), ChartAxis("", low, high)
        charts.append(Chart(panel, x_axis, y_axis, tuple(curves), height=100))
    save_panels(path, charts, columns=1, title=title)
    return path
