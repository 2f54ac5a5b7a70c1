"""Draws a recorded operator: the whole recording, and the part that is replayed."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ravenjax import robots
from ravenjax.document.figure_style import SOFT, STYLE
from ravenjax.report.drawing import save_figure
from ravenjax.report.run.plot import ARM_COLOURS
from ravenjax.store.files import require_writable
from ravenjax.store.motion.resampling import TICK_S
from ravenjax.store.motion.summary import TipCourse

OUTSIDE, GAP, JUMP = "#d9571b", "#8a8f96", "#8b2a6b"
ROWS = ("x, mm", "y, mm", "z, mm", "tip speed, mm/s")
DPI = 150
NEAR_S = 0.1
"""Samples within this time of a replayed part are drawn with it, s."""
DOTS = 400
"""Up to this number of samples, each is drawn as a dot, so that the spacing is visible."""


def motion_plot(courses: Sequence[TipCourse], out: Path, name: str, title: str) -> list[Path]:
    """Draw `courses` into the folder `out` as NAME.svg and NAME.png and return their paths.

    The left column shows the whole recording, the right one the replayed part: the tip in frame 0
    of its arm, and its speed. Raises StoreError if the folder cannot be written.
    """
    require_writable(out)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 0.9 + 1.45 * len(ROWS) * len(courses)), layout="constrained")
        widths = (3, 2) if all(len(course.replayed_s) for course in courses) else (1,)
        rows = len(ROWS) * len(courses)
        grid = figure.subplots(rows, len(widths), squeeze=False, sharex="col", width_ratios=widths)
        for number, course in enumerate(courses):
            _draw(grid[number * len(ROWS) : (number + 1) * len(ROWS)], course)
        for axes in grid[-1]:
            axes.set_xlabel("time in the recording, s")
        handles = {
            label: handle
            for axes in grid.flat
            for handle, label in zip(*axes.get_legend_handles_labels(), strict=True)
        }
        names, drawn = list(handles), list(handles.values())
        figure.legend(drawn, names, loc="outside lower center", ncols=5, fontsize=8)
        figure.suptitle(title, fontsize=10, x=0.01, ha="left")
        paths = [out / f"{name}.{kind}" for kind in ("svg", "png")]
        for path in paths:
            save_figure(figure, path, DPI)
    return paths


def _draw(grid: np.ndarray, course: TipCourse) -> None:
    before = _place_and_speed(course.recorded_s, course.recorded)
    replayed = len(course.replayed_s) > 0
    # A part may be played backwards after it ends; only the way forward is drawn.
    last = int(np.argmax(course.replayed_s)) + 1 if replayed else 0
    after_s = course.replayed_s[:last]
    after = _place_and_speed(np.arange(last) * TICK_S, course.replayed[:last])
    spans = [(times[0], times[-1]) for times in (course.recorded_s, after_s) if len(times)]
    for row, columns in enumerate(grid):
        columns[0].set_ylabel(f"{course.arm} {ROWS[row]}" if row == 0 else ROWS[row])
        for axes, (begin, end) in zip(columns, spans, strict=True):
            near = (course.recorded_s >= begin - NEAR_S) & (course.recorded_s <= end + NEAR_S)
            style = "o-" if near.sum() <= DOTS else "-"
            look: Any = {"ms": 2, "lw": 0.8, "color": SOFT, "label": "recorded"}
            axes.plot(course.recorded_s[near], before[near, row], style, **look)
            if replayed:
                colour = ARM_COLOURS[robots.USUAL.arms.index(course.arm)]
                axes.plot(
                    after_s, after[:, row], color=colour, lw=1.3, label=f"replayed, {course.arm}"
                )
            axes.set_xlim(begin, end)
            _mark(axes, course)


def _mark(axes: Axes, course: TipCourse) -> None:
    limits = axes.get_xlim()
    for begin, end in course.outside:
        axes.axvspan(begin, end, color=OUTSIDE, alpha=0.2, lw=0, label="outside the joint limits")
    for begin, end in course.gaps:
        axes.axvspan(begin, end, color=GAP, alpha=0.25, lw=0, label="gap")
    for time in course.spikes:
        axes.axvline(time, color=JUMP, lw=0.8, ls=(0, (2, 2)), label="jump")
    axes.set_xlim(limits)


def _place_and_speed(time_s: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return [samples, 4] in mm and mm/s; the speed is since the previous sample."""
    speed = np.zeros(len(time_s))
    if len(time_s) > 1:
        speed[1:] = np.linalg.norm(np.diff(place, axis=0), axis=1) / np.diff(time_s)
        speed[0] = speed[1]
    return np.column_stack([place, speed]) * 1e3
