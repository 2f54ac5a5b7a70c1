"""Draws one run: distance of the true and the reported tip, force, commands and states."""

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ravenjax import robots
from ravenjax.document.figure_style import INK, STYLE
from ravenjax.report.drawing import save_figure
from ravenjax.report.run.summary import active_spans
from ravenjax.vocabulary.robot import Robot

ARM_COLOURS = ("#b8860b", "#117a52", "#0072b2", "#8b2a6b")
JOINT_COLOURS = ("#0072b2", "#d9571b", "#8b2a6b", "#56b4e9", "#009e73", "#7a6a00", "#555555")
MARKERS = ("#c2410c", "#0072b2", "#5b6470", "#8b2a6b")
FAULT = "#d9571b"
SHOWN_JOINTS = 3
"""Number of joints in the DAC panel, those with the largest peaks."""
SUBTITLE_LETTERS = 105
"""Characters per line of the subtitle."""

Series: TypeAlias = Mapping[str, np.ndarray]


def trace_plot(
    series: Mapping[str, np.ndarray],
    path: Path,
    *,
    title: str = "",
    subtitle: str = "",
    threshold_mm: float = 3.0,
    events: Mapping[str, float] | None = None,
    robot: Robot = robots.USUAL,
) -> Path:
    """Draw the time series of one run at 1 kHz into `path` (.svg, .png or .pdf) and return it.

    series: as `store.logs.trace.log.write_trace` takes them. threshold_mm: of the cue whose force
    is drawn. events: {label: time in ms} of vertical markers; negative times are left out.
    """
    arrays = {name: np.asarray(values) for name, values in series.items()}
    arms = {
        arm: ARM_COLOURS[number % len(ARM_COLOURS)]
        for number, arm in enumerate(robot.arms)
        if f"{arm}/position" in arrays or f"{arm}/current_cmd" in arrays
    }
    ticks = len(next(iter(arrays.values())))
    time_s = np.arange(ticks) / 1000.0
    commands = {arm: arrays[f"{arm}/current_cmd"] for arm in arms if f"{arm}/current_cmd" in arrays}
    heights = [2.2, 1.2, *(1.8 for _ in commands), 0.9]
    path = Path(path)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.6, 1.25 * sum(heights)), layout="constrained")
        panels = figure.subplots(len(heights), 1, sharex=True, height_ratios=heights)
        error, force, *dacs, state = panels
        _draw_tips(error, time_s, arrays, arms, threshold_mm)
        _draw_force(force, time_s, arrays, arms)
        for axes, (arm, command) in zip(dacs, commands.items(), strict=True):
            _draw_dac(axes, time_s, command, robot.joints)
            axes.set_ylabel(f"{arm} {axes.get_ylabel()}")
        for name, colour in (("runlevel", "#1b1f24"), ("pedal", "#56b4e9")):
            if name in arrays:
                value = arrays[name].astype(float)
                state.step(time_s, value, color=colour, where="post", lw=1.2, label=name)
        state.set_ylabel("state")
        state.set_ylim(-0.3, len(robot.run_levels) - 0.5)
        state.set_yticks(range(len(robot.run_levels)))
        _add_legend(state)
        marks = {name: ms for name, ms in (events or {}).items() if ms >= 0}
        spans = active_spans(np.ravel(arrays.get("fault_active", ())))
        for start, end in spans:
            for axes in panels:
                axes.axvspan(start / 1000.0, end / 1000.0, color=FAULT, alpha=0.13, lw=0, zorder=0)
        if spans and "fault" not in marks:
            _note(error, "fault", (spans[0][0] / 1000.0, 1), (2, -2), FAULT, va="top")
        for number, (label, ms) in enumerate(sorted(marks.items(), key=lambda item: item[1])):
            colour = MARKERS[number % len(MARKERS)]
            for axes in panels:
                axes.axvline(ms / 1000.0, color=colour, lw=0.9)
            _note(error, f"{label} {ms:.0f} ms", (ms / 1000.0, 1), (2, 3 + 10 * number), colour)
        state.set_xlabel("time, s")
        state.set_xlim(0.0, ticks / 1000.0)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10, fontweight="bold")
        lines = textwrap.fill(subtitle, SUBTITLE_LETTERS)
        room = 4 + 10 * len(marks)
        error.set_title(lines, loc="left", x=0.0, fontsize=8.5, color=INK, pad=room)
        figure.align_ylabels(list(panels))
        save_figure(figure, path)
    return path


def _draw_tips(
    axes: Axes, time_s: np.ndarray, arrays: Series, arms: Mapping[str, str], threshold_mm: float
) -> None:
    kinds = {"tip": ("true", 1.5, "-"), "position": ("as reported", 1.0, (0, (3, 1.5)))}
    for arm, colour in arms.items():
        for name, (kind, width, style) in kinds.items():
            if f"{arm}/{name}" in arrays and f"{arm}/model_position" in arrays:
                off = arrays[f"{arm}/{name}"] - arrays[f"{arm}/model_position"]
                distance, label = 1000.0 * np.linalg.norm(off, axis=1), f"{arm}, {kind}"
                axes.plot(time_s, distance, color=colour, lw=width, ls=style, label=label)
    axes.axhline(threshold_mm, color=INK, lw=0.9, ls=(0, (4, 2)))
    place, words = ("axes fraction", "data"), f"cue at {threshold_mm:g} mm"
    _note(axes, words, (1, threshold_mm), (-2, 2), INK, xycoords=place, ha="right")
    axes.set_ylabel("tip off the\nnominal model, mm")
    axes.set_ylim(0.0, max(1.15 * _peak(axes), 1.3 * threshold_mm))
    _add_legend(axes)


def _draw_force(axes: Axes, time_s: np.ndarray, arrays: Series, arms: Mapping[str, str]) -> None:
    for arm, colour in arms.items():
        if f"{arm}/haptic_force" in arrays:
            force = arrays[f"{arm}/haptic_force"]
            size = np.abs(force) if force.ndim == 1 else np.linalg.norm(force, axis=1)
            axes.fill_between(time_s, size, color=colour, alpha=0.25, lw=0)
            axes.plot(time_s, size, color=colour, lw=1.1)
    axes.set_ylabel("haptic force,\ndevice units")
    axes.set_ylim(0.0, 1.15 * _peak(axes) or 1.0)
    if not _peak(axes):
        axes.set_yticks([0.0])
        _note(axes, "none", (0.01, 0.5), (0, 0), "#5b6470", xycoords="axes fraction", va="center")


def _draw_dac(axes: Axes, time_s: np.ndarray, command: np.ndarray, names: Sequence[str]) -> None:
    peaks = np.abs(command.astype(float)).max(axis=0)
    for joint in sorted(np.argsort(-peaks, kind="stable")[:SHOWN_JOINTS]):
        name, colour = names[joint], JOINT_COLOURS[joint % len(JOINT_COLOURS)]
        axes.step(time_s, command[:, joint], color=colour, where="post", lw=1.0, label=name)
    axes.set_ylabel("DAC, counts")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:,.0f}".replace("-", "−"))
    _add_legend(axes)


def _peak(axes: Axes) -> float:
    return axes.dataLim.ymax if np.isfinite(axes.dataLim.ymax) else 0.0


def _add_legend(axes: Axes) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(fontsize=8, handlelength=1.4, loc="upper left", bbox_to_anchor=(1.0, 1.03))


def _note(
    axes: Axes,
    text: str,
    at: tuple[float, float],
    offset: tuple[float, float],
    colour: str,
    **look: Any,
) -> None:
    look = {"xycoords": ("data", "axes fraction")} | look
    axes.annotate(
        text, at, xytext=offset, textcoords="offset points", fontsize=8, color=colour, **look
    )
