"""The path of a tip in space: where the instrument went, where the model says it should be, and what spoke when."""

from __future__ import annotations

from typing import Any

import numpy as np

from ravenjax.figure_style import FONT, json_of
from ravenjax.report.replays import Replay
from ravenjax.report.style import CUE, RESPONSE

HEIGHT = 460  # px
SCALE = [[0.0, "#56b4e9"], [0.5, "#0072b2"], [0.75, "#8b2a6b"], [1.0, "#d9571b"]]
"""Colour over time, from blue to vermilion."""
MARKS = {"first effect": "#8a8f96", "cue": CUE, "response": RESPONSE, "harm": "#8b2a6b"}
AXIS = "#9aa3ad"  # a fill that is see-through is unknown to WebGL axes
LEAST = 0.15
"""Of the longest side, each side of the box is at least so long: a flat path keeps readable axes."""
MODEL, TWIN = "#8a8f96", "#009e73"


def path(replay: Replay) -> str:
    """Figure of one run's paths in mm. The last two traces are the marks at the present time: instrument and model."""
    tip, model = replay.paths["true tip"], replay.paths["nominal model"]
    traces = [
        _line(tip, "instrument", 5)
        | {
            "showlegend": False,  # plotly would draw a black line for one that has many colours
            "line": {
                "width": 5,
                "color": replay.time_ms.tolist(),
                "colorscale": SCALE,
                "colorbar": {"title": {"text": "instrument, ms"}, "thickness": 10, "len": 0.6, "outlinewidth": 0},
            },
            "customdata": np.stack([replay.time_ms, replay.deviation_mm.round(2)], axis=1).tolist(),
            "hovertemplate": "%{customdata[0]} ms, %{customdata[1]} mm off the model<extra></extra>",
        },
        _line(model, "nominal model", 3, MODEL),
    ]
    if "fault-free twin" in replay.paths:
        traces.append(_line(replay.paths["fault-free twin"], "fault-free twin", 3, TWIN))
    for label, point in replay.marks.items():
        traces.append(_mark(tip[point], f"{label}, {replay.time_ms[point]} ms", MARKS[label], 5, "diamond"))
    traces.append(_mark(tip[0], "instrument now", CUE, 6, "circle") | {"showlegend": False})
    traces.append(_mark(model[0], "model now", MODEL, 5, "circle") | {"showlegend": False})
    reach = np.ptp(np.concatenate(list(replay.paths.values())), axis=0)
    return json_of(traces, _layout(np.maximum(reach / reach.max(), LEAST) if reach.max() > 0 else np.ones(3)))


def course(replay: Replay) -> dict[str, Any]:
    """What the page's player needs: per point the time, both places and the distance, rounded."""
    return {
        "time": replay.time_ms.tolist(),
        "tip": replay.paths["true tip"].round(2).tolist(),
        "model": replay.paths["nominal model"].round(2).tolist(),
        "off": replay.deviation_mm.round(2).tolist(),
    }


def _line(points: np.ndarray, name: str, width: float, colour: str = "") -> dict[str, Any]:
    x, y, z = (axis.round(2).tolist() for axis in points.T)
    line: dict[str, Any] = {"width": width} | ({"color": colour} if colour else {})
    return {"type": "scatter3d", "mode": "lines", "x": x, "y": y, "z": z, "name": name, "line": line} | (
        {"hoverinfo": "name"} if colour else {}
    )


def _mark(point: np.ndarray, name: str, colour: str, size: float, symbol: str) -> dict[str, Any]:
    x, y, z = ([round(float(value), 2)] for value in point)
    return {
        "type": "scatter3d",
        "mode": "markers",
        "x": x,
        "y": y,
        "z": z,
        "name": name,
        "marker": {"color": colour, "size": size, "symbol": symbol},
        "hoverinfo": "name",
    }


def _layout(aspect: np.ndarray) -> dict[str, Any]:
    axis = {"gridcolor": AXIS, "zeroline": False, "showbackground": False, "nticks": 5}
    return {
        "height": HEIGHT,
        "margin": {"l": 0, "r": 0, "t": 0, "b": 0},
        "paper_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": FONT, "size": 12},
        "legend": {"orientation": "h", "x": 0, "y": 0, "yanchor": "top"},
        "scene": {
            "aspectmode": "manual",
            "aspectratio": {name: round(float(1.6 * part), 3) for name, part in zip("xyz", aspect, strict=True)},
            "camera": {"eye": {"x": 1.15, "y": 1.15, "z": 0.75}},
            **{f"{name}axis": axis | {"title": {"text": f"{name}, mm"}} for name in "xyz"},
        },
    }
