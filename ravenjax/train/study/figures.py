"""Figures of a study: effect sizes with intervals, curves of the time to a response, each
participant's mean.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ravenjax.document.figure_style import GRID, faded, json_of, look
from ravenjax.train.study.comparison import RIGHT, TIME, ComparedGroup, GroupComparison

COLOURS = ("#8a8f96", "#0072b2", "#c2410c", "#009e73", "#8b2a6b", "#56b4e9", "#a67c00")
"""Of the groups; the reference is grey."""
CURVE_HEIGHT, POINTS_HEIGHT = 340, 300


def forest_height(found: list[GroupComparison]) -> int:
    """px."""
    return 110 + 34 * len(found)


def forest(found: list[GroupComparison], labels: list[str]) -> str:
    """Standardised differences with their intervals, one line a comparison; right of 0 the group
    did better.
    """
    traces = []
    for label in dict.fromkeys(one.second.label for one in found):
        mine = [one for one in found if one.second.label == label and math.isfinite(one.g.value)]
        colour = COLOURS[labels.index(label) % len(COLOURS)]
        value = [one.outcome.better * one.g.value for one in mine]
        ends = [
            sorted((one.outcome.better * one.g.low, one.outcome.better * one.g.high))
            for one in mine
        ]
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": _finite(value),
                "y": [_row(one, found) for one in mine],
                "error_x": {
                    "type": "data",
                    "symmetric": False,
                    "array": _finite([high - v for v, (_, high) in zip(value, ends, strict=True)]),
                    "arrayminus": _finite(
                        [v - low for v, (low, _) in zip(value, ends, strict=True)]
                    ),
                    "color": colour,
                    "thickness": 2,
                    "width": 5,
                },
                "marker": {"color": colour, "size": 11},
                "name": label,
                "hovertemplate": "%{y}: %{x:.2f} standard deviations better<extra></extra>",
            }
        )
    layout = look(forest_height(found)) | {
        "margin": {"l": 210, "r": 24, "t": 14, "b": 50},
        "showlegend": len(labels) > 2,
        "xaxis": (
            _axis(f"better than {labels[0]}, standard deviations →")
            | {
                "zeroline": True,
                "zerolinecolor": "#8a8f96",
                "rangemode": "tozero",
            }
        ),
        "yaxis": {
            "autorange": "reversed",
            "type": "category",
            "gridcolor": GRID,
            "automargin": True,
        },
    }
    return json_of(traces, layout)


def curves(found: list[GroupComparison], labels: list[str], horizon: float) -> str | None:
    """Share of hazards that were answered by each time after their strike, with its band."""
    groups = _groups([one for one in found if one.outcome is TIME])
    traces: list[dict[str, Any]] = []
    for group in groups:
        if group.curve is None or not group.hazards:
            continue
        colour = COLOURS[labels.index(group.label) % len(COLOURS)]
        time, share, low, high = (
            np.append(part, part[-1]) if i else np.append(part, horizon)
            for i, part in enumerate(
                (group.curve.time, group.curve.fraction, group.curve.low, group.curve.high)
            )
        )
        step_x = np.repeat(time, 2)[1:]
        traces.append(
            {
                "type": "scatter",
                "x": np.concatenate([step_x, step_x[::-1]]).round(2).tolist(),
                "y": (
                    np.concatenate([np.repeat(high, 2)[:-1], np.repeat(low, 2)[:-1][::-1]])
                    .round(5)
                    .tolist()
                ),
                "fill": "toself",
                "fillcolor": faded(colour),
                "line": {"width": 0},
                "hoverinfo": "skip",
                "showlegend": False,
            }
        )
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": time.round(2).tolist(),
                "y": share.round(5).tolist(),
                "line": {"color": colour, "width": 2.2, "shape": "hv"},
                "name": f"{group.label} ({group.curve.events} of {group.hazards})",
                "hovertemplate": f"{group.label} by %{{x:.0f}} ms: %{{y:.0%}}<extra></extra>",
            }
        )
    if not traces:
        return None
    share_axis = _axis("hazards answered") | {"tickformat": ".0%", "range": [0, 1.02]}
    layout = look(CURVE_HEIGHT) | {
        "xaxis": _axis("ms after the strike") | {"range": [0, horizon]},
        "yaxis": share_axis,
    }
    return json_of(traces, layout)


def participants(one: GroupComparison, found: list[GroupComparison], labels: list[str]) -> str:
    """Mean of each participant in each group; lines join the same one where everyone did both."""
    groups = _groups([other for other in found if other.outcome is one.outcome])
    traces: list[dict[str, Any]] = []
    if one.paired and len(groups) == 2:
        for start, end in zip(groups[0].points, groups[1].points, strict=True):
            traces.append(
                {
                    "type": "scatter",
                    "mode": "lines",
                    "x": [0, 1],
                    "y": _finite([start, end]),
                    "hoverinfo": "skip",
                }
                | {"line": {"color": "rgba(128,128,128,0.45)", "width": 1.2}}
            )
    for place, group in enumerate(groups):
        colour = COLOURS[labels.index(group.label) % len(COLOURS)]
        spread = (
            np.zeros(len(group.points))
            if one.paired
            else np.linspace(-0.16, 0.16, max(1, len(group.points)))
        )
        traces.append(
            {
                "type": "scatter",
                "mode": "markers",
                "x": (place + spread[: len(group.points)]).round(3).tolist(),
                "y": _finite(group.points),
                "marker": {"color": colour, "size": 9, "opacity": 0.75},
                "hovertemplate": f"{group.label}: %{{y:.3~g}}<extra></extra>",
            }
        )
        traces.append(
            {
                "type": "scatter",
                "mode": "lines",
                "x": [place - 0.24, place + 0.24],
                "y": _finite([group.mean] * 2),
            }
            | {"line": {"color": colour, "width": 3}, "hoverinfo": "skip"}
        )
    title = "share right" if one.outcome is RIGHT else one.outcome.unit
    axis = (
        _axis(title)
        | {"rangemode": "tozero"}
        | ({"tickformat": ".0%", "range": [-0.04, 1.04]} if one.outcome is RIGHT else {})
    )
    layout = look(POINTS_HEIGHT) | {
        "showlegend": False,
        "title": {"text": one.outcome.name, "x": 0.5, "font": {"size": 13}},
        "xaxis": {
            "tickvals": list(range(len(groups))),
            "ticktext": [group.label for group in groups],
            "showgrid": False,
        }
        | {"range": [-0.6, len(groups) - 0.4], "zeroline": False},
        "yaxis": axis,
        "margin": {"l": 54, "r": 8, "t": 38, "b": 36},
    }
    return json_of(traces, layout)


def _groups(found: list[GroupComparison]) -> list[ComparedGroup]:
    """Each group of one outcome once, the reference first."""
    return [found[0].first, *(one.second for one in found)] if found else []


def _row(one: GroupComparison, found: list[GroupComparison]) -> str:
    several = len({other.second.label for other in found}) > 1
    return f"{one.outcome.name}, {one.second.label}" if several else one.outcome.name


def _finite(values: list[float]) -> list[float | None]:
    return [round(float(value), 5) if math.isfinite(value) else None for value in values]


def _axis(title: str) -> dict[str, Any]:
    return {"title": {"text": title}, "gridcolor": GRID, "zeroline": False}
