"""Figures of detectors: how well they tell harm, how soon they speak, how long before the harm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ravenjax.figure_style import GRID, json_of, look
from ravenjax.report.detectors import Curves, Level, Row
from ravenjax.report.figures import log_time
from ravenjax.report.style import SERIES, band, stepped

HEIGHT = 430  # px
DRAWN = 6
"""Curves shown at first, the largest areas; others wait in the legend."""


NEAR_MS = 500.0
"""About the harm, what the figure of leads shows at first."""


def roc(rows: Sequence[Row]) -> str | None:
    """Figure of caught harmful runs over alarms in harmless ones; None where no detector has a curve."""
    return _figure(rows, "roc", "share of harmless runs with an alarm", "share of harmful runs with an alarm")


def precision_recall(rows: Sequence[Row]) -> str | None:
    """Figure of the share of alarms that tell of harm over caught harmful runs."""
    return _figure(rows, "recall", "share of harmful runs with an alarm", "share of alarms that tell of harm")


def delays(curves: Sequence[Curves], end_ms: int) -> str:
    """Figure of the time from the first effect to the alarm, over harmful runs."""
    traces = []
    for number, one in enumerate(curves):
        traces += _steps(one, stepped(one.delay, end_ms, start=1.0), number, "%{x:.0f} ms after the first effect")
    return json_of(traces, _layout(log_time(), "share of harmful runs with an alarm"))


def leads(curves: Sequence[Curves]) -> str:
    """Figure of the time between alarm and harm, over harmful runs; left of 0 there is time to act."""
    starts, ends = ([one.lead.lag.time[end] for one in curves] for end in (0, -1))
    traces = []
    for number, one in enumerate(curves):
        traces += _steps(one, stepped(one.lead.lag, float(max(ends))), number, "%{x:.0f} ms after the harm")
    time = {
        "title": {"text": "alarm minus harm, ms"},
        "range": [max(-NEAR_MS, float(min(starts)) - 10.0), min(NEAR_MS, float(max(ends)) + 10.0)],
        "gridcolor": GRID,
        "zeroline": True,
        "zerolinecolor": "rgba(128,128,128,0.8)",
    }
    return json_of(traces, _layout(time, "share of harmful runs with an alarm"))


def colour(number: int) -> str:
    """Colour of the detector of this number, the same in every figure."""
    return SERIES[number % len(SERIES)]


def _layout(across: dict[str, Any], up: str) -> dict[str, Any]:
    share = {"title": {"text": up}, "tickformat": ".0%", "range": [-0.02, 1.03], "gridcolor": GRID, "zeroline": False}
    return look(HEIGHT) | {"xaxis": across, "yaxis": share}


def _figure(rows: Sequence[Row], kind: str, across: str, up: str) -> str | None:
    numbered = [(number, row) for number, row in enumerate(rows) if getattr(row, kind) is not None]
    if not numbered:
        return None
    largest = sorted(numbered, key=lambda pair: -getattr(pair[1], kind).area.value)[:DRAWN]
    traces: list[dict[str, Any]] = []
    for number, row in enumerate(rows):
        shown = (number, row) in largest or getattr(row, kind) is None
        traces += _one(row, number, kind, shown)
    if kind == "roc":
        chance = {"type": "scatter", "mode": "lines", "x": [0, 1], "y": [0, 1], "showlegend": False}
        traces.insert(0, chance | {"hoverinfo": "skip", "line": {"color": GRID, "width": 1.2, "dash": "dot"}})
    axis = {"title": {"text": across}, "tickformat": ".0%", "range": [-0.02, 1.02], "gridcolor": GRID}
    return json_of(traces, _layout(axis | {"zeroline": False}, up))


def _one(row: Row, number: int, kind: str, shown: bool) -> list[dict[str, Any]]:
    """Curve with band and marks of the levels; of what has a single level, the mark alone."""
    same: dict[str, Any] = {"type": "scatter", "legendgroup": row.name} | ({} if shown else {"visible": "legendonly"})
    traces = []
    found = getattr(row, kind)
    if found is not None:
        value = np.asarray(found.curve.value)
        known = np.isfinite(value)
        hue = band(found.grid, np.asarray(found.curve.low), np.asarray(found.curve.high), colour(number))
        line = {
            "mode": "lines",
            "x": found.grid[known].round(5).tolist(),
            "y": value[known].round(5).tolist(),
            "name": f"{row.name} ({found.area.value:.3f})",
            "line": {"color": colour(number), "width": 2},
            "hovertemplate": f"{row.name}<br>%{{x:.1%}}, %{{y:.1%}}<extra></extra>",
        }
        traces += [hue | same, line | same]
    points = [(level, *_place(level, kind)) for level in row.levels]
    points = [point for point in points if np.isfinite(point[1:]).all()]
    mark = {
        "mode": "markers",
        "cliponaxis": False,
        "x": [x for _, x, _ in points],
        "y": [y for _, _, y in points],
        "marker": {
            "color": colour(number),
            "size": [11 if level.quiet else 7 for level, *_ in points] if found else 11,
            "symbol": "circle" if found else "diamond",
            "line": {"color": "#ffffff", "width": 1},
        },
        "name": row.name,
        "showlegend": found is None,
        "text": [f"{row.name}" if np.isnan(level.level) else f"{row.name} at {level.level:g}" for level, *_ in points],
        "hovertemplate": "%{text}<br>%{x:.1%}, %{y:.1%}<extra></extra>",
    }
    return [*traces, mark | same] if points else traces


def _place(level: Level, kind: str) -> tuple[float, float]:
    if kind == "roc":
        return level.harmless.value, level.caught.value
    return level.caught.value, level.precision.value


def _steps(one: Curves, drawn: dict[str, np.ndarray], number: int, when: str) -> list[dict[str, Any]]:
    name = one.name if np.isnan(one.level) else f"{one.name} at {one.level:g}"
    same: dict[str, Any] = {"legendgroup": one.name} | ({} if number < 2 * DRAWN else {"visible": "legendonly"})
    line = {
        "type": "scatter",
        "mode": "lines",
        "x": drawn["x"].tolist(),
        "y": drawn["y"].tolist(),
        "name": name,
        "line": {"color": colour(number), "width": 2, "shape": "hv"},
        "hovertemplate": f"{name}: %{{y:.1%}} by {when}<extra></extra>",
    }
    return [line | same]
