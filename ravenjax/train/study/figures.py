"""Figures of a study: each participant's mean, by group."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from ravenjax.document.figure_style import GRID, json_of, look
from ravenjax.train.study.comparison import RIGHT, GroupComparison

COLOURS = ("#8a8f96", "#0072b2", "#c2410c", "#009e73", "#8b2a6b", "#56b4e9", "#a67c00")
"""Of the groups; the reference is grey."""
HEIGHT = 300


def participants(found: list[GroupComparison]) -> str:
    """Mean of each participant in each group, of the comparisons of one outcome; lines join the
    same one where everyone did both.
    """
    one = found[0]
    groups = [one.first, *(each.second for each in found)]
    traces: list[dict[str, Any]] = []
    if one.paired and len(groups) == 2:
        for ends in zip(groups[0].points, groups[1].points, strict=True):
            traces.append(_line([0, 1], ends, "rgba(128,128,128,0.45)", 1.2))
    for place, group in enumerate(groups):
        colour, count = COLOURS[place % len(COLOURS)], len(group.points)
        spread = np.zeros(count) if one.paired else np.linspace(-0.16, 0.16, count)
        dots = _line(place + spread, group.points, colour, 0) | {"mode": "markers"}
        dots |= {"marker": {"color": colour, "size": 9, "opacity": 0.75}, "hoverinfo": None}
        traces.append(dots | {"hovertemplate": f"{group.label}: %{{y:.3~g}}<extra></extra>"})
        traces.append(_line([place - 0.24, place + 0.24], [group.mean] * 2, colour, 3))
    is_rate = one.outcome is RIGHT
    axis = {"title": {"text": "share right" if is_rate else one.outcome.unit}, "gridcolor": GRID}
    axis |= {"zeroline": False, "rangemode": "tozero"}
    if is_rate:
        axis |= {"tickformat": ".0%", "range": [-0.04, 1.04]}
    names = {"tickvals": list(range(len(groups))), "ticktext": [group.label for group in groups]}
    names |= {"showgrid": False, "zeroline": False, "range": [-0.6, len(groups) - 0.4]}
    layout = look(HEIGHT) | {
        "showlegend": False,
        "title": {"text": one.outcome.name, "x": 0.5, "font": {"size": 13}},
        "xaxis": names,
        "yaxis": axis,
        "margin": {"l": 54, "r": 8, "t": 38, "b": 36},
    }
    return json_of(traces, layout)


def _line(x: Iterable[float], y: Iterable[float], colour: str, width: float) -> dict[str, Any]:
    points = {"type": "scatter", "mode": "lines", "x": _finite(x), "y": _finite(y)}
    return points | {"line": {"color": colour, "width": width}, "hoverinfo": "skip"}


def _finite(values: Iterable[float]) -> list[float | None]:
    return [round(float(value), 5) if math.isfinite(value) else None for value in values]
