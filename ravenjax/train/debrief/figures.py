"""Curves of a session as plotly figures: distances and their limits, depth, force, pedal, state
of the robot; and how a person did from session to session.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from ravenjax.document.figure_style import GRID, json_of, look
from ravenjax.robots.raven2 import run_levels
from ravenjax.train.debrief.course import Course, peaks
from ravenjax.train.debrief.words import Step
from ravenjax.train.judge.row import HazardRow

MARKS = {
    "strike": "#a23b82",
    "knowable": "#8a8f96",
    "cue": "#c2410c",
    "alarm": "#a67c00",
    "response": "#0072b2",
}
"""Colour of each moment; blue and vermilion differ in every colour blindness."""
UNINTENDED, LOSS, FALSE_REPORT = "#a23b82", "#a67c00", "#5b4b9a"
ERROR, KNOWN, DEPTH, FORCE, LINE = "#0072b2", "#56b4e9", "#009e73", "#c2410c", "#8a8f96"
_DARK, _PALE = "#1b1f24", "#ffffff"
_QUIET, _GOOD, _WARM = ("#c9ccd0", _DARK), ("#56b4e9", _DARK), ("#e9b18f", _DARK)
_BAD = (UNINTENDED, _PALE)
LANES = {
    "robot": (
        "runlevel",
        {
            run_levels.E_STOP: ("E-stop", _BAD),
            run_levels.INIT: ("init", _WARM),
            run_levels.PEDAL_UP: ("pedal up", _QUIET),
            run_levels.PEDAL_DOWN: ("driven", (DEPTH, _PALE)),
        },
    ),
    "pedal": ("pedal", {0: ("up", _QUIET), 1: ("down", _GOOD)}),
    "session": (
        "phase",
        {
            0: ("ready", _QUIET),
            1: ("running", _GOOD),
            2: ("paused", _WARM),
            3: ("stopped", _BAD),
            4: ("over", _QUIET),
        },
    ),
}
"""Channel of each lane of bars; word, colour and ink of each of its states."""
LEARNING = (
    ("score", "score of 100", UNINTENDED),
    ("reaction_ms", "reaction, ms", ERROR),
    ("path_mm", "path, mm", DEPTH),
    ("sparc", "smoothness (SPARC)", FORCE),
)
"""Field of `learning.Attempt`, its axis, its colour."""
BEFORE_MS, AFTER_MS, LONGEST_MS = 400, 800, 8000
# px: of a small panel, of the gap above it, of a lane, of the name of a moment above the panels
PANEL, GAP, LANE, NAME = 78, 22, 24, 16
MARGIN = {"l": 66, "r": 16, "t": 30, "b": 92}
# px of the largest panel, that of the distances
MAIN = 210


class Figure(NamedTuple):
    """A figure as plotly's JSON, and its height in px."""

    json: str
    height: int


class _Panel(NamedTuple):
    """One of the panels below each other."""

    title: str
    traces: list[dict[str, Any]]
    height: int  # px
    axis: dict[str, Any]


def hazard(course: Course, one: HazardRow, steps: Sequence[Step]) -> Figure | None:
    """Figure of one hazard in ms after its strike; None where the recording does not reach it."""
    if one.struck_ms is None:
        return None
    came = [(step, step.after_ms) for step in steps if step.after_ms is not None]
    end = min(max(max((ms for _, ms in came), default=0.0) + AFTER_MS, 1500.0), LONGEST_MS)
    inside = (course.ms >= one.struck_ms - BEFORE_MS) & (course.ms <= one.struck_ms + end)
    if inside.sum() < 2:
        return None
    arms = [one.arm] if one.arm in course.layout.arms else list(course.layout.arms)
    time = course.ms[inside] - one.struck_ms
    panels = _panels(course, inside, time, arms, ["robot", "pedal"])
    traces, layout = _stacked(panels, "ms after the strike", len(came))
    layout["xaxis"]["range"] = [-BEFORE_MS, end]
    _add_levels(layout, course)
    top, name = layout["yaxis"]["domain"][1], NAME * _pixel(layout["height"])
    for place, (step, ms) in enumerate(came):
        text = step.text or step.name if step.kind == "response" else step.name
        above = len(came) - place
        _add_moment(layout, ms, step.kind, top + name * above, text, top + name * (above - 1))
    return _figure(traces, layout)


def overview(course: Course, hazards: Sequence[HazardRow]) -> Figure | None:
    """Figure of the whole session in s, with the hazards and the progress of the task."""
    if len(course.ms) < 2:
        return None
    time, everything = course.ms / 1000, np.ones(len(course.ms), bool)
    panels = _panels(course, everything, time, list(course.layout.arms), list(LANES))
    traces, layout = _stacked(panels, "s into the session", 1)
    layout["xaxis"]["range"] = [0, time[-1]]
    _add_levels(layout, course)
    top = layout["yaxis"]["domain"][1]
    for one in hazards:
        if one.struck_ms is not None:
            name = one.hazard or str(one.number)
            _add_moment(layout, one.struck_ms / 1000, "strike", 1.0, name, top)
            if one.response_ms is not None:
                _add_moment(layout, one.response_ms / 1000, "response", top)
    return _figure(traces, layout)


def loop(course: Course) -> Figure | None:
    """Figure of the loop's quality over the session: slowest tick and latest start of each
    stretch, us.
    """
    if len(course.ms) < 2:
        return None
    traces = []
    for name, colour in (("compute", ERROR), ("lateness", FORCE)):
        values = np.maximum(course.channel(f"{name}_us"), 1.0)
        traces.append(_curve(*peaks(course.ms / 1000, values, 400), name, colour, "us"))
    panel = _Panel("us, worst of a stretch", traces, 118, {"type": "log", "dtick": 1})
    traces, layout = _stacked([panel], "s into the session", 0)
    return _figure(traces, layout | {"hovermode": "x unified"})


def learning(attempts: Sequence[Any]) -> Figure | None:
    """The numbers of one person's sessions, a panel each; None for less than two sessions."""
    if len(attempts) < 2:
        return None
    numbers = list(range(1, len(attempts) + 1))
    panels = []
    for field, title, colour in LEARNING:
        values = [getattr(attempt, field) for attempt in attempts]
        if any(value is not None for value in values):
            curve = _curve_of(numbers, values, title, colour, "%{text}: %{y:.4g}<extra></extra>")
            curve |= {"mode": "lines+markers", "text": [attempt.name for attempt in attempts]}
            panels.append(_Panel(title, [curve], PANEL, {"nticks": 4, "rangemode": "normal"}))
    traces, layout = _stacked(panels, "session", 0)
    layout["xaxis"]["dtick"] = 1
    return _figure(traces, layout | {"showlegend": False})


def _panels(
    course: Course, inside: np.ndarray, time: np.ndarray, arms: Sequence[str], lanes: list[str]
) -> list[_Panel]:
    """Distances, depth, force (and the task's progress) under one another, and lanes of pedal
    and robot below.
    """

    def worst(name: str) -> np.ndarray:
        return course.worst(name, arms)[inside]

    def curve(name: str, colour: str, values: np.ndarray, unit: str = "") -> dict[str, Any]:
        return _curve(*peaks(time, values), name, colour, unit)

    unintended = np.maximum(worst("unintended_mm"), worst("unintended_off_mm"))
    distances = [curve("unintended motion of the true tip", UNINTENDED, unintended, "mm")]
    limit = math.inf if course.limit_mm is None else course.limit_mm
    for channel, label, colour in (
        ("loss_mm", "true tip off, not following", LOSS),
        ("false_report_mm", "reported tip off the true one", FALSE_REPORT),
    ):
        if (worst(channel) > limit).any():
            distances.append(curve(label, colour, worst(channel), "mm"))
    known = curve("reported tip off the golden run", KNOWN, worst("known_mm"), "mm")
    known["line"]["dash"] = "dot"
    error = curve("reported tip off the model", ERROR, worst("error_mm"), "mm")
    panels = [_Panel("distance, mm", [*distances, known, error], MAIN, {"nticks": 7})]
    felt = (course.channel("cue_on")[inside] > 0) & (not course.blinded)
    force = np.where(felt, worst("force"), 0.0)
    for title, label, colour, values in (
        ("depth, mm", "depth in the tissue", DEPTH, worst("depth_mm")),
        ("force", "force felt", FORCE, force),
    ):
        if np.nanmax(values) > 0:
            line = curve(label, colour, np.maximum(values, 0.0))
            panels.append(_Panel(title, [line], PANEL, {"nticks": 3}))
    if "session" in lanes:
        line = curve("progress of the task", LINE, course.channel("progress")[inside])
        axis = {"nticks": 3, "range": [0, 1.05], "tickformat": ".0%"}
        panels.append(_Panel("task", [line], PANEL, axis))
    bars = [bar for lane in lanes for bar in _bars(course, inside, time, lane)]
    axis = {"showgrid": False, "fixedrange": True}
    return [*panels, _Panel("", bars, LANE * len(lanes), axis)]


def _stacked(
    panels: list[_Panel], x_title: str, names: int
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Traces and layout of panels from the top; `names`: lines of names above them."""
    gaps = GAP * (len(panels) - 1)
    inner = sum(panel.height for panel in panels) + gaps + NAME * names
    height = inner + MARGIN["t"] + MARGIN["b"]
    legend = {"orientation": "h", "x": 0, "y": -52 / inner, "yanchor": "top"}
    layout = look(height) | {"margin": MARGIN, "hovermode": "closest", "barmode": "stack"}
    layout |= {"legend": legend | {"traceorder": "normal"}, "shapes": [], "annotations": []}
    traces, top = [], inner - NAME * names
    for number, panel in enumerate(panels):
        axis = "y" if number == 0 else f"y{number + 1}"
        traces += [trace | {"yaxis": axis} for trace in panel.traces]
        domain = [(top - panel.height) / inner, top / inner]
        top -= panel.height + GAP
        layout[axis.replace("y", "yaxis")] = {
            "title": {"text": panel.title},
            "domain": [max(0.0, domain[0]), domain[1]],
            "gridcolor": GRID,
            "zeroline": False,
            "rangemode": "tozero",
        } | panel.axis
        layout["xaxis"] = {
            "title": {"text": x_title},
            "gridcolor": GRID,
            "zeroline": False,
            "anchor": axis,
            "hoverformat": ".2~f",
        }
    return traces, layout


def _pixel(height: int) -> float:
    """A pixel as a fraction of the drawn area's height."""
    return 1 / (height - MARGIN["t"] - MARGIN["b"])


def _add_levels(layout: dict[str, Any], course: Course) -> None:
    """Dashed lines across the distances, with their labels."""
    for level, name in (
        (course.threshold_mm, "threshold of the cue"),
        (course.limit_mm, "limit of hazards"),
    ):
        if level is None:
            continue
        line = {"color": LINE, "width": 1.2, "dash": "dash"}
        shape = {"type": "line", "xref": "paper", "x0": 0, "x1": 1, "yref": "y"}
        layout["shapes"].append(shape | {"y0": level, "y1": level, "line": line})
        place = {"xref": "paper", "x": 1, "y": level, "xanchor": "right", "yanchor": "bottom"}
        font = {"size": 11, "color": LINE}
        text = {"text": f"{level:g} mm, {name}", "font": font, "showarrow": False}
        layout["annotations"].append(place | text)


def _add_moment(
    layout: dict[str, Any],
    at: float,
    kind: str,
    top: float,
    name: str = "",
    name_at: float = 0.0,
) -> None:
    """A line through all panels up to `top`, and its name at a height of the paper."""
    line = {"color": MARKS[kind], "width": 1.4}
    shape = {"type": "line", "x0": at, "x1": at, "yref": "paper", "y0": 0, "y1": top}
    layout["shapes"].append(shape | {"line": line})
    if name:
        place = {"x": at, "y": name_at, "yref": "paper", "xanchor": "left", "yanchor": "bottom"}
        font = {"size": 11.5, "color": MARKS[kind]}
        layout["annotations"].append(place | {"text": name, "font": font, "showarrow": False})


def _bars(course: Course, inside: np.ndarray, time: np.ndarray, lane: str) -> list[dict[str, Any]]:
    """Bars of one state over time, one trace a state."""
    channel, states = LANES[lane]
    codes = np.nan_to_num(course.channel(channel)[inside], nan=-1).astype(int)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(codes)) + 1])
    ends = np.append(time[starts[1:]], time[-1])
    out = []
    for code, (word, (colour, ink)) in states.items():
        mine = codes[starts] == code
        count = int(mine.sum())
        if count:
            out.append(
                {
                    "type": "bar",
                    "orientation": "h",
                    "y": [lane] * count,
                    "base": time[starts][mine].round(3).tolist(),
                    "x": (ends - time[starts])[mine].round(3).tolist(),
                    "marker": {"color": colour},
                    "offset": -0.35,
                    "width": 0.7,
                    "showlegend": False,
                    "text": [word] * count,
                    "textposition": "inside",
                    "insidetextanchor": "start",
                    "insidetextfont": {"size": 10, "color": ink},
                    "textangle": 0,
                    "hovertemplate": f"{lane}: {word}, from %{{base}}<extra></extra>",
                }
            )
    return out


def _curve(
    time: np.ndarray, values: np.ndarray, name: str, colour: str, unit: str = ""
) -> dict[str, Any]:
    hover = f"{name}: %{{y:.2f}} {unit}<extra></extra>"
    return _curve_of(time.round(3).tolist(), values.round(4).tolist(), name, colour, hover)


def _curve_of(x: list[Any], y: list[Any], name: str, colour: str, hover: str) -> dict[str, Any]:
    line = {"color": colour, "width": 1.8}
    points = {"type": "scatter", "mode": "lines", "x": x, "y": y}
    return points | {"name": name, "line": line, "hovertemplate": hover}


def _figure(traces: list[dict[str, Any]], layout: dict[str, Any]) -> Figure:
    return Figure(json_of(traces, layout), layout["height"])
