"""Learning curves: the sessions of one person in one scenario, beside one another in a folder."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ravenjax.document.figure_style import GRID, json_of, look
from ravenjax.train.debrief.figures import DEPTH, ERROR, FORCE, UNINTENDED, Figure
from ravenjax.train.recording import folders
from ravenjax.train.recording.folders import SessionFolder

MEASURES = "dexterity"
"""Key of a session's summary."""
_PANEL, _EDGE = 120, 60  # px


class Attempt(NamedTuple):
    """One session of the curve; None where it left no such number."""

    name: str
    started: str
    score: float | None  # mean of its hazards
    reaction_ms: float | None  # median
    path_mm: float | None  # of all tips
    sparc: float | None  # mean of the tips
    idle: float | None


PANELS = (
    ("score", "score of 100", UNINTENDED),
    ("reaction_ms", "reaction, ms", ERROR),
    ("path_mm", "path, mm", DEPTH),
    ("sparc", "smoothness (SPARC)", FORCE),
)
"""Field of `Attempt`, its axis, its colour."""


def attempts(folder: Path) -> list[Attempt]:
    """The sessions of the same person and scenario up to that of `folder`; none where the person
    is not named.
    """
    here = next(
        (one for one in folders.beside(folder.parent) if one.path.name == folder.name), None
    )
    if here is None or not here.participant:
        return []
    return [
        _attempt(one)
        for one in folders.beside(folder.parent)
        if (one.participant, one.scenario) == (here.participant, here.scenario)
        and (one.started, one.path.name) <= (here.started, here.path.name)
        and MEASURES in one.summary
    ]


def figure(course: Sequence[Attempt]) -> Figure | None:
    """The curves, a panel each; None for less than two sessions."""
    if len(course) < 2:
        return None
    panels = [
        panel for panel in PANELS if any(getattr(one, panel[0]) is not None for one in course)
    ]
    height = _PANEL * len(panels) + _EDGE
    layout: dict[str, Any] = look(height) | {
        "margin": {"l": 66, "r": 16, "t": 12, "b": 48},
        "showlegend": False,
    }
    layout["xaxis"] = {
        "title": {"text": "session"},
        "dtick": 1,
        "gridcolor": GRID,
        "anchor": f"y{len(panels)}",
    }
    traces = []
    for k, (name, axis, colour) in enumerate(panels):
        number = "" if k == 0 else str(k + 1)
        top = 1 - k / len(panels)
        layout[f"yaxis{number}"] = {
            "title": {"text": axis, "font": {"size": 11}},
            "domain": [top - 0.8 / len(panels), top],
            "gridcolor": GRID,
            "nticks": 4,
            "zeroline": False,
        }
        traces.append(
            {
                "type": "scatter",
                "mode": "lines+markers",
                "x": list(range(1, len(course) + 1)),
                "y": [getattr(one, name) for one in course],
                "text": [one.name for one in course],
                "name": axis,
                "yaxis": f"y{number}",
                "line": {"color": colour, "width": 1.8},
                "hovertemplate": "%{text}: %{y:.4g}<extra></extra>",
            }
        )
    return Figure(json_of(traces, layout), height)


def _attempt(one: SessionFolder) -> Attempt:
    measures, hazards = one.summary[MEASURES], one.summary.get("hazards") or {}
    arms = list(measures.get("arms", {}).values())
    smooth = [arm["sparc"] for arm in arms if arm.get("sparc") is not None]
    return Attempt(
        one.path.name,
        one.started,
        hazards.get("score"),
        hazards.get("median_reaction_ms"),
        sum(arm.get("path_mm") or 0.0 for arm in arms) if arms else None,
        statistics.fmean(smooth) if smooth else None,
        measures.get("idle"),
    )
