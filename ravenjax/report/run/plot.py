"""One run as a figure for a paper or a report: how far the tip went, what the hand felt, what the
motors were told.

Two tips are drawn: the true one, where the links of the virtual robot are, and the one that the
robot reports, on which the cue acts.
"""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ravenjax import robots
from ravenjax.document.figure_style import STYLE
from ravenjax.store.files import write_aside
from ravenjax.vocabulary.robot import Robot

ARM_COLOURS = ("#b8860b", "#117a52", "#0072b2", "#8b2a6b")
JOINT_COLOURS = ("#0072b2", "#d9571b", "#8b2a6b", "#56b4e9", "#009e73", "#7a6a00", "#555555")
MARKERS = ("#c2410c", "#0072b2", "#5b6470", "#8b2a6b")
FAULT = "#d9571b"
SHOWN_JOINTS = 3
"""Joints in the DAC panel: those told to go to, or the ones with the largest peaks."""
SUBTITLE_LETTERS = 105
"""Letters in a line of the subtitle."""


def trace_plot(
    series: Mapping[str, np.ndarray],
    path: Path,
    *,
    title: str = "",
    subtitle: str = "",
    threshold_mm: float = 3.0,
    joints: Sequence[str] = (),
    dac_limits: Mapping[str, float] | None = None,
    events: Mapping[str, float] | None = None,
    robot: Robot = robots.USUAL,
) -> Path:
    """Draw the time series of one run at 1 kHz into `path` (.svg, .png or .pdf) and return it.

    series: as `store.logs.trace.log.write` takes them. Drawn are, per arm and where present, the distances of `tip`
        (true) and `position` (as reported) from `model_position`, `haptic_force` and `current_cmd`; and `runlevel`,
        `pedal`, `fault_active` [T].
    threshold_mm: of the cue whose force is drawn.
    joints: names of the joints whose DACs are drawn; by default the SHOWN_JOINTS with the largest peaks.
    dac_limits: largest allowed |DAC|, counts, by joint name.
    events: {label: time in ms} of vertical markers (cue, response); negative times are left out.
    """  # noqa: E501
    arrays = {name: np.asarray(values) for name, values in series.items()}
    there = [
        arm for arm in robot.arms if f"{arm}/position" in arrays or f"{arm}/current_cmd" in arrays
    ]
    arms = {arm: ARM_COLOURS[robot.arms.index(arm) % len(ARM_COLOURS)] for arm in there}
    ticks = len(next(iter(arrays.values())))
    time_s = np.arange(ticks) / 1000.0
    dac_panels = [arm for arm in arms if f"{arm}/current_cmd" in arrays]
    heights = [2.2, 1.2, *(1.8 for _ in dac_panels), 0.9]
    path = Path(path)
    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(7.6, 1.25 * sum(heights)), layout="constrained")
        error, force, *dacs, state = figure.subplots(
            len(heights), 1, sharex=True, height_ratios=heights
        )
        _tip_error(error, time_s, arrays, arms, threshold_mm)
        _force(force, time_s, arrays, arms)
        for axes, arm in zip(dacs, dac_panels, strict=True):
            _dac(
                axes,
                time_s,
                arrays[f"{arm}/current_cmd"],
                f"{arm} DAC",
                robot.joints,
                joints,
                dac_limits or {},
            )
        _state(state, time_s, arrays, len(robot.run_levels))
        panels = [error, force, *dacs, state]
        marks = {name: ms for name, ms in (events or {}).items() if ms >= 0}
        _fault_windows(panels, arrays, told="fault" in marks)
        _events(panels, marks)
        state.set_xlabel("time, s")
        state.set_xlim(0.0, ticks / 1000.0)
        figure.suptitle(title, x=0.01, ha="left", fontsize=10, fontweight="bold")
        lines = textwrap.fill(subtitle, SUBTITLE_LETTERS)
        error.set_title(
            lines, loc="left", x=0.0, fontsize=8.5, color="#3a424c", pad=4 + 10 * len(marks)
        )
        figure.align_ylabels(panels)
        kind = path.suffix.lstrip(".") or "png"
        dateless = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind, {})
        write_aside(
            path, lambda target: figure.savefig(target, format=kind, dpi=160, metadata=dateless)
        )
    return path


def _tip_error(
    axes: Axes,
    time_s: np.ndarray,
    arrays: Mapping[str, np.ndarray],
    arms: Mapping[str, str],
    threshold_mm: float,
) -> None:
    kinds = {"tip": ("true", 1.5, "-"), "position": ("as reported", 1.0, (0, (3, 1.5)))}
    for arm in arms:
        for name, (kind, width, style) in kinds.items():
            if f"{arm}/{name}" in arrays and f"{arm}/model_position" in arrays:
                distance = 1000.0 * np.linalg.norm(
                    arrays[f"{arm}/{name}"] - arrays[f"{arm}/model_position"], axis=1
                )
                axes.plot(
                    time_s, distance, color=arms[arm], lw=width, ls=style, label=f"{arm}, {kind}"
                )
    axes.axhline(threshold_mm, color="#3a424c", lw=0.9, ls=(0, (4, 2)))
    place = {
        "xycoords": ("axes fraction", "data"),
        "xytext": (-2, 2),
        "textcoords": "offset points",
    }
    axes.annotate(
        f"cue at {threshold_mm:g} mm",
        (1, threshold_mm),
        **place,
        ha="right",
        fontsize=8,
        color="#3a424c",
    )
    axes.set_ylabel("tip off the\nnominal model, mm")
    axes.set_ylim(0.0, max(1.15 * _peak(axes), 1.3 * threshold_mm))
    _legend(axes, True)


def _force(
    axes: Axes, time_s: np.ndarray, arrays: Mapping[str, np.ndarray], arms: Mapping[str, str]
) -> None:
    for arm in arms:
        if f"{arm}/haptic_force" in arrays:
            force = arrays[f"{arm}/haptic_force"]
            size = np.abs(force) if force.ndim == 1 else np.linalg.norm(force, axis=1)
            axes.fill_between(time_s, size, color=arms[arm], alpha=0.25, lw=0)
            axes.plot(time_s, size, color=arms[arm], lw=1.1)
    axes.set_ylabel("haptic force,\ndevice units")
    if _peak(axes) > 0.0:
        axes.set_ylim(0.0, 1.15 * _peak(axes))
    else:
        axes.set_ylim(0.0, 1.0)
        axes.set_yticks([0.0])
        axes.annotate(
            "none", (0.01, 0.5), xycoords="axes fraction", va="center", fontsize=8, color="#5b6470"
        )


def _dac(
    axes: Axes,
    time_s: np.ndarray,
    command: np.ndarray,
    title: str,
    names: Sequence[str],
    joints: Sequence[str],
    limits: Mapping[str, float],
) -> None:
    peaks = np.abs(command.astype(float)).max(axis=0)
    numbers = [names.index(name) for name in joints] or sorted(
        np.argsort(-peaks, kind="stable")[:SHOWN_JOINTS]
    )
    for joint in numbers:
        name, colour = names[joint], JOINT_COLOURS[joint % len(JOINT_COLOURS)]
        axes.plot(
            time_s, command[:, joint], color=colour, lw=1.0, label=name, drawstyle="steps-post"
        )
        if name in limits:
            for limit in (-limits[name], limits[name]):
                axes.axhline(limit, color=colour, lw=0.8, ls=(0, (1, 2)))
    axes.set_ylabel(f"{title}, counts\n(dotted: limit)" if limits else f"{title}, counts")
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:,.0f}".replace("-", "−"))
    _legend(axes, True)


def _state(axes: Axes, time_s: np.ndarray, arrays: Mapping[str, np.ndarray], levels: int) -> None:
    for name, colour, style in (("runlevel", "#1b1f24", "-"), ("pedal", "#56b4e9", "-")):
        if name in arrays:
            axes.plot(
                time_s,
                arrays[name].astype(float),
                color=colour,
                ls=style,
                lw=1.2,
                label=name,
                drawstyle="steps-post",
            )
    axes.set_ylabel("state")
    axes.set_ylim(-0.3, levels - 0.5)
    axes.set_yticks(range(levels))
    _legend(axes, True)


def _peak(axes: Axes) -> float:
    """Largest number drawn; 0 where nothing was."""
    return axes.dataLim.ymax if np.isfinite(axes.dataLim.ymax) else 0.0


def _legend(axes: Axes, wanted: bool) -> None:
    handles, labels = axes.get_legend_handles_labels()
    if wanted and handles:
        axes.legend(
            handles,
            labels,
            loc="upper left",
            bbox_to_anchor=(1.0, 1.03),
            fontsize=8,
            handlelength=1.4,
        )


def _fault_windows(panels: Sequence[Axes], arrays: Mapping[str, np.ndarray], told: bool) -> None:
    active = np.asarray(arrays.get("fault_active", ()), bool).reshape(-1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], active, [False]]).astype(int)))
    for start, end in edges.reshape(-1, 2) / 1000.0:
        for axes in panels:
            axes.axvspan(start, end, color=FAULT, alpha=0.13, lw=0, zorder=0)
    if len(edges) and not told:
        panels[0].annotate(
            "fault",
            (edges[0] / 1000.0, 1),
            xycoords=("data", "axes fraction"),
            xytext=(2, -2),
            textcoords="offset points",
            va="top",
            fontsize=8,
            color=FAULT,
        )


def _events(panels: Sequence[Axes], events: Mapping[str, float]) -> None:
    for i, (label, time_ms) in enumerate(sorted(events.items(), key=lambda item: item[1])):
        colour = MARKERS[i % len(MARKERS)]
        for axes in panels:
            axes.axvline(time_ms / 1000.0, color=colour, lw=0.9)
        panels[0].annotate(
            f"{label} {time_ms:.0f} ms",
            (time_ms / 1000.0, 1),
            xycoords=("data", "axes fraction"),
            xytext=(2, 3 + 10 * i),
            textcoords="offset points",
            fontsize=8,
            color=colour,
        )
