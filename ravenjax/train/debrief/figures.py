"""Curves of a session as plotly figures: distances and their limits, depth, force, pedal, state
of the robot.
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
DARK, PALE = "#1b1f24", "#ffffff"
RUNLEVELS = {
    run_levels.E_STOP: ("E-stop", "#a23b82", PALE),
    run_levels.INIT: ("init", "#e9b18f", DARK),
    run_levels.PEDAL_UP: ("pedal up", "#c9ccd0", DARK),
    run_levels.PEDAL_DOWN: ("driven", "#009e73", PALE),
}
PEDAL = {0: ("up", "#c9ccd0", DARK), 1: ("down", "#56b4e9", DARK)}
PHASES = {
    0: ("ready", "#c9ccd0", DARK),
    1: ("running", "#56b4e9", DARK),
    2: ("paused", "#e9b18f", DARK),
    3: ("stopped", "#a23b82", PALE),
    4: ("over", "#c9ccd0", DARK),
}
"""Word, colour and ink of each state."""
BEFORE_MS, AFTER_MS, LONGEST_MS = 400, 800, 8000
MARGIN = {"l": 66, "r": 16, "t": 30, "b": 92}  # px
PANEL = 100
"""px of a small panel with its gap; left out where there is nothing in it."""
NAME = 16
"""px of the name of a moment above the panels."""
HEIGHT, OVERVIEW_HEIGHT, LOOP_HEIGHT = 640, 680, 240


class Figure(NamedTuple):
    """A figure as plotly's JSON, and its height in px."""

    json: str
    height: int


def hazard(course: Course, one: HazardRow, steps: Sequence[Step]) -> Figure | None:
    """Figure of one hazard in ms after its strike; None where the recording does not reach it."""
    if one.struck_ms is None:
        return None
    last = max([0.0, *(step.after_ms for step in steps if step.after_ms is not None)])
    end = min(max(last + AFTER_MS, 1500.0), LONGEST_MS)
    inside = (course.ms >= one.struck_ms - BEFORE_MS) & (course.ms <= one.struck_ms + end)
    if inside.sum() < 2:
        return None
    arms = [one.arm] if one.arm in course.layout.arms else list(course.layout.arms)
    time = course.ms[inside] - one.struck_ms
    came = [step for step in steps if step.after_ms is not None]
    traces, layout = _panels(course, inside, time, arms, "ms after the strike", len(came))
    layout["xaxis"]["range"] = [-BEFORE_MS, end]
    top, name = layout["yaxis"]["domain"][1], NAME * _pixel(layout["height"])
    layout["shapes"] += [_line(step.after_ms or 0.0, MARKS[step.kind]) for step in came]
    for place, step in enumerate(came):
        text = step.name if step.kind != "response" else step.text or step.name
        layout["annotations"].append(
            _name(step.after_ms, top + name * (len(came) - 1 - place), text, step.kind)
        )
        layout["shapes"][-len(came) + place]["y1"] = top + name * (len(came) - place)
    return _figure(traces, layout)


def overview(course: Course, hazards: Sequence[HazardRow]) -> Figure | None:
    """Figure of the whole session in s, with the hazards and the progress of the task."""
    if len(course.ms) < 2:
        return None
    everything = np.ones(len(course.ms), bool)
    traces, layout = _panels(
        course,
        everything,
        course.ms / 1000,
        list(course.layout.arms),
        "s into the session",
        session=True,
    )
    layout["xaxis"]["range"] = [0, course.ms[-1] / 1000]
    top = layout["yaxis"]["domain"][1]
    for one in hazards:
        if one.struck_ms is None:
            continue
        layout["shapes"].append(_line(one.struck_ms / 1000, MARKS["strike"]))
        if one.response_ms is not None:
            layout["shapes"].append(_line(one.response_ms / 1000, MARKS["response"], top))
        layout["annotations"].append(
            _name(one.struck_ms / 1000, top, one.hazard or str(one.number), "strike")
        )
    return _figure(traces, layout)


def loop(course: Course) -> Figure | None:
    """Figure of the loop's quality over the session: slowest tick and latest start of each
    stretch, us.
    """
    if len(course.ms) < 2:
        return None
    traces = [
        _curve(
            *peaks(course.ms / 1000, np.maximum(course.channel(name), 1.0), 400),
            label,
            colour,
            "y",
            "us",
        )
        for name, label, colour in (
            ("compute_us", "compute", ERROR),
            ("lateness_us", "lateness", FORCE),
        )
    ]
    axis = {
        "title": {"text": "us, worst of a stretch"},
        "gridcolor": GRID,
        "type": "log",
        "dtick": 1,
    }
    return _figure(
        traces, _look(LOOP_HEIGHT) | {"xaxis": _time_axis("s into the session", "y"), "yaxis": axis}
    )


def _panels(
    course: Course,
    inside: np.ndarray,
    time: np.ndarray,
    arms: Sequence[str],
    title: str,
    above: int = 1,
    session: bool = False,
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Distances, depth, force (and the task's progress) under one another, and lanes of pedal
    and robot below.
    """
    traces = []
    for label, colour, values in _distances(course, inside, arms):
        traces.append(_curve(*peaks(time, values), label, colour, "y", "mm"))
        traces[-1]["line"]["dash"] = "dot" if colour == KNOWN else "solid"
    felt = (course.channel("cue_on")[inside] > 0) & (not course.blinded)
    force = np.where(felt, course.worst("force", arms)[inside], 0.0)
    depth = np.maximum(course.worst("depth_mm", arms)[inside], 0.0)
    singles = [
        one
        for one in (
            ("depth, mm", "depth in the tissue", DEPTH, depth),
            ("force", "force felt", FORCE, force),
        )
        if np.nanmax(one[3]) > 0
    ]
    if session:
        singles.append(("task", "progress of the task", LINE, course.channel("progress")[inside]))
    height = (OVERVIEW_HEIGHT if session else HEIGHT) - PANEL * (2 + session - len(singles))
    domains = _domains(len(singles), 3 if session else 2, above, height)
    layout = _look(height) | {"shapes": [], "annotations": [], "barmode": "stack"}
    axis = {"gridcolor": GRID, "zeroline": False, "rangemode": "tozero", "nticks": 5}
    layout["yaxis"] = axis | {"domain": domains[0], "title": {"text": "distance, mm"}, "nticks": 7}
    for i, (unit, label, colour, values) in enumerate(singles):
        traces.append(_curve(*peaks(time, values), label, colour, f"y{i + 2}"))
        layout[f"yaxis{i + 2}"] = axis | {
            "domain": domains[i + 1],
            "title": {"text": unit},
            "nticks": 3,
        }
        if unit == "task":
            layout[f"yaxis{i + 2}"] |= {"range": [0, 1.05], "tickformat": ".0%"}
    lanes = f"y{len(singles) + 2}"
    layout["yaxis" + lanes[1:]] = {
        "domain": domains[-1],
        "showgrid": False,
        "zeroline": False,
        "fixedrange": True,
    }
    kinds = [("robot", "runlevel", RUNLEVELS), ("pedal", "pedal", PEDAL)]
    for lane, name, words in [*kinds, ("session", "phase", PHASES)] if session else kinds:
        traces += _lane(time, course.channel(name)[inside], lane, words, lanes)
    layout["xaxis"] = _time_axis(title, lanes)
    lines = ((course.threshold_mm, "threshold of the cue"), (course.limit_mm, "limit of hazards"))
    for level, name in lines:
        if level is not None:
            shape, label = _level(level, name)
            layout["shapes"].append(shape)
            layout["annotations"].append(label)
    return traces, layout


def _distances(
    course: Course, inside: np.ndarray, arms: Sequence[str]
) -> list[tuple[str, str, np.ndarray]]:
    """Label, colour and values of each distance. Loss of motion and false reports: where they
    exceed the limit.
    """

    def worst(name: str) -> np.ndarray:
        return course.worst(name, arms)[inside]

    limit = math.inf if course.limit_mm is None else course.limit_mm
    distances = [
        (
            "unintended motion of the true tip",
            UNINTENDED,
            np.maximum(worst("unintended_mm"), worst("unintended_off_mm")),
        )
    ]
    for name, label, colour in (
        ("loss_mm", "true tip off, not following", LOSS),
        ("false_report_mm", "reported tip off the true one", FALSE_REPORT),
    ):
        values = worst(name)
        if (values > limit).any():
            distances.append((label, colour, values))
    return [
        *distances,
        ("reported tip off the golden run", KNOWN, worst("known_mm")),
        ("reported tip off the model", ERROR, worst("error_mm")),
    ]


def _level(level: float, name: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """A dashed line across the distances, and its label."""
    line = {"color": LINE, "width": 1.2, "dash": "dash"}
    shape = {
        "type": "line",
        "xref": "paper",
        "x0": 0,
        "x1": 1,
        "yref": "y",
        "y0": level,
        "y1": level,
        "line": line,
    }
    label = {
        "xref": "paper",
        "x": 1,
        "y": level,
        "xanchor": "right",
        "yanchor": "bottom",
        "showarrow": False,
    }
    return shape, label | {"text": f"{level:g} mm, {name}", "font": {"size": 11, "color": LINE}}


def _domains(singles: int, lanes: int, above: int, height: int) -> list[list[float]]:
    """Heights of the panels from the top: the first is the largest, the lanes the smallest."""
    pixel = _pixel(height)
    gap, each = 22 * pixel, (PANEL - 22) * pixel
    out: list[list[float]] = [[0.0, 24 * lanes * pixel]]
    for _ in range(singles):
        start = out[-1][1] + gap
        out.append([start, start + each])
    out.append([out[-1][1] + gap, 1 - NAME * above * pixel])
    return [out[-1], *out[-2:0:-1], out[0]]


def _pixel(height: int) -> float:
    """A pixel as a fraction of the drawn area's height."""
    return 1 / (height - MARGIN["t"] - MARGIN["b"])


def _lane(
    time: np.ndarray,
    values: np.ndarray,
    lane: str,
    words: dict[int, tuple[str, str, str]],
    axis: str,
) -> list[dict[str, Any]]:
    """Bars of one state over time, one trace a state."""
    codes = np.nan_to_num(values, nan=-1).astype(int)
    starts = np.concatenate([[0], np.flatnonzero(np.diff(codes)) + 1])
    ends = np.append(time[starts[1:]], time[-1])
    out = []
    for code, (word, colour, ink) in words.items():
        mine = codes[starts] == code
        if mine.any():
            begin, length = time[starts][mine], (ends - time[starts])[mine]
            out.append(
                {
                    "type": "bar",
                    "orientation": "h",
                    "y": [lane] * int(mine.sum()),
                    "base": begin.round(3).tolist(),
                    "x": length.round(3).tolist(),
                    "marker": {"color": colour},
                    "offset": -0.35,
                    "width": 0.7,
                    "yaxis": axis,
                    "showlegend": False,
                    "text": [word] * int(mine.sum()),
                    "textposition": "inside",
                    "insidetextanchor": "start",
                    "insidetextfont": {"size": 10, "color": ink},
                    "textangle": 0,
                    "hovertemplate": f"{lane}: {word}, from %{{base}}<extra></extra>",
                }
            )
    return out


def _curve(
    time: np.ndarray, values: np.ndarray, name: str, colour: str, axis: str, unit: str = ""
) -> dict[str, Any]:
    return {
        "type": "scatter",
        "mode": "lines",
        "x": time.round(3).tolist(),
        "y": values.round(4).tolist(),
        "name": name,
        "yaxis": axis,
        "line": {"color": colour, "width": 1.8},
        "hovertemplate": f"{name}: %{{y:.2f}} {unit}<extra></extra>",
    }


def _line(at: float, colour: str, top: float = 1.0) -> dict[str, Any]:
    line = {"color": colour, "width": 1.4}
    return {"type": "line", "x0": at, "x1": at, "yref": "paper", "y0": 0, "y1": top, "line": line}


def _name(at: float | None, above: float, text: str, mark: str) -> dict[str, Any]:
    """The name of a moment over the panels."""
    place = {
        "x": at,
        "y": above,
        "yref": "paper",
        "xanchor": "left",
        "yanchor": "bottom",
        "showarrow": False,
    }
    return place | {"text": text, "font": {"size": 11.5, "color": MARKS[mark]}}


def _time_axis(title: str, anchor: str) -> dict[str, Any]:
    return {
        "title": {"text": title},
        "gridcolor": GRID,
        "zeroline": False,
        "anchor": anchor,
        "hoverformat": ".2~f",
    }


def _look(height: int) -> dict[str, Any]:
    legend = {
        "orientation": "h",
        "x": 0,
        "y": -52 * _pixel(height),
        "yanchor": "top",
        "traceorder": "normal",
    }
    hover = "x unified" if height < HEIGHT else "closest"
    return look(height) | {"margin": MARGIN, "hovermode": hover, "legend": legend}


def _figure(traces: list[dict[str, Any]], layout: dict[str, Any]) -> Figure:
    return Figure(json_of(traces, layout), layout["height"])
