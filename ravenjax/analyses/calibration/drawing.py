"""Draws a calibration: following errors of log and robot, and the intervals of the parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.analyses.calibration.calibrate import NORMAL_90, SETTLING, Calibration
from ravenjax.analyses.calibration.joint_log import JointLog
from ravenjax.analyses.calibration.tables import PER_UNIT, UNITS
from ravenjax.document.figure_style import STYLE
from ravenjax.report.drawing import save_figure
from ravenjax.robots.raven2.arms import JOINTS

LOG, ROBOT, GREY = "#1b1f24", "#d9571b", "#5b6470"


def draw_errors(path: Path, log: JointLog, replayed: np.ndarray, until: int) -> None:
    """Write following errors by joint as SVG. `replayed`: [n, 7] of the calibrated robot; `until`:
    last cycle that was fitted to.
    """
    _save(
        path,
        (10.0, 1.0 + 1.3 * len(log.joints)),
        lambda figure: _draw_errors(figure, log, replayed, until),
    )


def draw_intervals(path: Path, calibrated: Calibration) -> None:
    """Write 90 % intervals of the parameters before and after the log as SVG."""
    rows = len(calibrated.unknowns)
    _save(path, (7.0, 1.2 + 0.22 * rows), lambda figure: _draw_intervals(figure, calibrated))


def _save(path: Path, size: tuple[float, float], draw: Any) -> None:
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure)
        save_figure(figure, path)


def _draw_errors(figure: Any, log: JointLog, replayed: np.ndarray, until: int) -> None:
    axes = figure.subplots(len(log.joints), 1, sharex=True, squeeze=False)[:, 0]
    seconds, desired = log.cycles * 1e-3, log.desired[log.cycles]
    for axis, joint in zip(axes, log.joints, strict=True):
        for joints, colour, label in (
            (log.measured, LOG, "log"),
            (replayed, ROBOT, "calibrated robot"),
        ):
            error = (joints[:, joint] - desired[:, joint]) * PER_UNIT[joint]
            axis.plot(seconds, error, color=colour, linewidth=0.8, label=label)
        axis.axvspan(
            0.0, SETTLING * 1e-3, color=GREY, alpha=0.12, linewidth=0.0, label="not compared"
        )
        axis.axvline(
            until * 1e-3,
            color=GREY,
            linewidth=0.8,
            linestyle="--",
            label="fitted to the left alone",
        )
        axis.set_ylabel(f"{JOINTS[joint].replace('_', ' ')}, {UNITS[joint]}")
    figure.suptitle("Following error, measured minus desired", fontsize=10)
    figure.legend(
        *axes[0].get_legend_handles_labels(), loc="outside lower center", fontsize=8, ncols=4
    )
    axes[-1].set_xlabel("s")
    figure.align_ylabels(axes)


def _draw_intervals(figure: Any, calibrated: Calibration) -> None:
    axis = figure.subplots()
    rows = np.arange(len(calibrated.unknowns))
    steps, half = calibrated.fit.steps, NORMAL_90 * calibrated.told
    axis.barh(
        rows,
        2.0 * NORMAL_90,
        left=-NORMAL_90,
        height=0.7,
        color=GREY,
        alpha=0.2,
        label="before the log",
    )
    axis.errorbar(
        steps, rows, xerr=half, fmt="o", markersize=3, color=ROBOT, linewidth=1.2, label="after it"
    )
    axis.set_yticks(
        rows,
        [one.path.replace("_", " ").replace(".", ", ") for one in calibrated.unknowns],
        fontsize=8,
    )
    axis.invert_yaxis()
    axis.set_xlabel("standard deviations of the belief before, from its middle; 90 % intervals")
    figure.legend(loc="outside lower center", fontsize=8, ncols=2)
