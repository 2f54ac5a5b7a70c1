"""Makes tables and figures of a calibration: each joint's following error, fitted parameters."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ravenjax.analyses.calibration.calibrate import NORMAL_90, SETTLING, Calibration, FollowingError
from ravenjax.analyses.calibration.joint_log import JointLog
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots
from ravenjax.report.drawing import save_panels
from ravenjax.robots.raven2.arms import JOINTS

PER_UNIT = np.array((180.0 / np.pi,) * 2 + (1e3,) + (180.0 / np.pi,) * 4)
"""Factors from rad and m to deg and mm for display."""
UNITS = ("deg", "deg", "mm", "deg", "deg", "deg", "deg")
LOG, ROBOT = "same", "cue"
"""Names of colours."""
MAX_SPREAD_RATIO = 0.5
"""Largest standard deviation, as a share of the prior one, of a parameter that counts as known."""

PARAMETER_COLUMNS = ("parameter", "prior", "fitted", "5 %", "95 %", "spread left")
"""Headings of the rows of `tabulate_parameters`."""


def by_joint(
    rows: Sequence[FollowingError], joints: Sequence[int]
) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Return headings, and one row per joint: the rms following error of log and models. A model's
    cell also contains the ratio of its error to the log's, and its distance from the log.
    """
    log, *models = rows
    cells = [
        (
            f"{JOINTS[j].replace('_', ' ')}, {UNITS[j]}",
            f"{log.following[j] * PER_UNIT[j]:.3f}",
            *(
                f"{model.following[j] * PER_UNIT[j]:.3f}"
                f" ({model.following[j] / log.following[j]:.2f})\noff"
                f" {model.residual[j] * PER_UNIT[j]:.3f}"
                for model in models
            ),
        )
        for j in joints
    ]
    return ("joint", *(row.model for row in rows)), cells


def tabulate_parameters(calibrated: Calibration) -> list[tuple[str, ...]]:
    """Return one row for each estimated parameter. A row contains the value before and after the
    fit, the ends of the 90 % interval, and the standard deviation after the fit as a share of the
    prior one. Shares above MAX_SPREAD_RATIO are marked as not determined.
    """
    fitted = (calibrated.before, calibrated.after, *calibrated.interval, calibrated.spread_ratio)
    rows = zip(calibrated.unknowns, *fitted, strict=True)
    return [
        (
            unknown.path,
            f"{before:.4g}",
            f"{after:.3g}",
            f"{lower:.3g}",
            f"{upper:.3g}",
            f"{spread_ratio:.2f}"
            + ("" if spread_ratio <= MAX_SPREAD_RATIO else " (not determined)"),
        )
        for unknown, before, after, lower, upper, spread_ratio in rows
    ]


def draw_errors(path: Path, log: JointLog, replayed: np.ndarray, until: int) -> None:
    """Write a chart of following errors for each joint as SVG. `replayed`: joint positions [n, 7]
    of the calibrated robot. `until`: last cycle of the part to which the robot was fitted.
    """
    seconds, desired = log.cycles * 1e-3, log.desired[log.cycles]
    time = f"time, s; the fit uses {SETTLING * 1e-3:g} s to the line"
    across = ChartAxis(time, 0.0, float(seconds[-1]), line=until * 1e-3)
    charts = []
    for joint in log.joints:
        errors = [
            (joints[:, joint] - desired[:, joint]) * PER_UNIT[joint]
            for joints in (log.measured, replayed)
        ]
        curves = (
            Curve("log", LOG, seconds, errors[0]),
            Curve("calibrated robot", ROBOT, seconds, errors[1]),
        )
        up = ChartAxis(UNITS[joint], float(np.nanmin(errors)), float(np.nanmax(errors)))
        title = f"{JOINTS[joint].replace('_', ' ')}, measured minus desired"
        charts.append(Chart(title, across, up, curves, height=130))
    save_panels(path, charts, columns=1)


def draw_intervals(path: Path, calibrated: Calibration) -> None:
    """Write 90 % intervals of the parameters before and after the log as SVG."""
    names = tuple(
        unknown.path.replace("_", " ").replace(".", ", ") for unknown in calibrated.unknowns
    )
    rows, steps = np.arange(len(names), dtype=float), calibrated.fit.steps
    # Half the length of each interval, in prior standard deviations.
    half, prior_half = NORMAL_90 * calibrated.spread_ratio, np.full(len(names), NORMAL_90)
    end = max(NORMAL_90, float((np.abs(steps) + half).max()))
    dots = (
        Dots("before the log", LOG, 0.0 * prior_half, rows, -prior_half, prior_half),
        Dots("after the log", ROBOT, steps, rows, steps - half, steps + half),
    )
    across = ChartAxis(
        "distance from the prior mean, in prior standard deviations; 90 % intervals", -end, end
    )
    up = ChartAxis("", 0.0, len(names), names=names)
    save_panels(path, [Chart("", across, up, dots, height=60 + 22 * len(names))])
