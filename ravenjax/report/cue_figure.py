"""Figure of the cue sweep: what each haptic set misses over what it disturbs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ravenjax.figure_style import GRID, json_of, look
from ravenjax.report import wording
from ravenjax.report.cue_sweep import Row
from ravenjax.report.style import CUE, SAME

HEIGHT = 380  # px


def tradeoff(rows: Sequence[Row]) -> str | None:
    """Missed hazards over false cues an hour, one mark a set, those that none beats joined; None without either."""
    able = [row for row in rows if row.missed.n and row.per_hour is not None]
    if not able:
        return None
    best = sorted((row for row in able if row.best), key=lambda row: (_hourly(row), row.missed.value))
    front = {
        "type": "scatter",
        "mode": "lines",
        "x": [_hourly(row) for row in best],
        "y": [row.missed.value for row in best],
        "line": {"color": CUE, "width": 1.4, "dash": "dot", "shape": "hv"},
        "hoverinfo": "skip",
        "showlegend": False,
    }
    traces = [front]
    for is_best, name, colour in ((False, "beaten by another", SAME), (True, "no other does better", CUE)):
        mine = [row for row in able if row.best == is_best]
        if mine:
            traces.append(_marks(mine, name, colour))
    most = [max(_hourly(row) for row in able) or 1.0, max(row.missed.value for row in able) or 0.01]
    layout = look(HEIGHT) | {
        "xaxis": {
            "title": {"text": "false cues per hour of fault-free motion"},
            "range": [-0.03 * most[0], 1.14 * most[0]],
            "gridcolor": GRID,
            "zeroline": False,
        },
        "yaxis": {
            "title": {"text": "harmful faults without a cue"},
            "tickformat": ".0%",
            "range": [-0.05 * most[1], 1.1 * most[1]],
            "gridcolor": GRID,
            "zeroline": False,
        },
    }
    return json_of(traces, layout)


def _hourly(row: Row) -> float:
    assert row.per_hour is not None
    return row.per_hour.per_hour


def _marks(rows: Sequence[Row], name: str, colour: str) -> dict[str, Any]:
    force = np.array([row.force for row in rows])
    scale = np.nan_to_num(force / np.nanmax(force)) if np.isfinite(force).any() else np.zeros(len(rows))
    groups: dict[float, Row] = {}
    for row in rows:  # gains that change only the force fall on one mark: one label for them
        groups.setdefault(row.cue.threshold_mm, row)
    return {
        "type": "scatter",
        "mode": "markers+text",
        "cliponaxis": False,
        "name": name,
        "x": [_hourly(row) for row in rows],
        "y": [row.missed.value for row in rows],
        "text": [f"{row.cue.threshold_mm:g} mm" if groups[row.cue.threshold_mm] is row else "" for row in rows],
        "textposition": "middle right",
        "marker": {"color": colour, "size": (9 + 7 * scale).round(1).tolist(), "opacity": 0.85},
        "customdata": [[row.told, wording.interval(row.missed), _pulse(row)] for row in rows],
        "hovertemplate": "%{customdata[0]}<br>missed %{y:.1%} (%{customdata[1]})<br>%{x:.1f} false cues an hour"
        "<br>%{customdata[2]}<extra></extra>",
    }


def _pulse(row: Row) -> str:
    return f"peak force {wording.number(row.force)}, felt for {wording.number(row.felt_ms)} ms"
