"""Draws a calibration: following errors of log and robot, and the intervals of the parameters."""

from pathlib import Path

import numpy as np

from ravenjax.analyses.calibration.calibrate import NORMAL_90, SETTLING, Calibration
from ravenjax.analyses.calibration.joint_log import JointLog
from ravenjax.analyses.calibration.tables import PER_UNIT, UNITS
from ravenjax.document.chart import Chart, ChartAxis, Curve, Dots
from ravenjax.report.drawing import save_panels
from ravenjax.robots.raven2.arms import JOINTS

LOG, ROBOT = "same", "cue"
"""Colours."""


def draw_errors(path: Path, log: JointLog, replayed: np.ndarray, until: int) -> None:
    """Write following errors by joint as SVG. `replayed`: [n, 7] of the calibrated robot; `until`:
    last cycle that was fitted to.
    """
    seconds, desired = log.cycles * 1e-3, log.desired[log.cycles]
    time = f"s; fitted from {SETTLING * 1e-3:g} s to the line"
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
    places, steps = np.arange(len(names), dtype=float), calibrated.fit.steps
    half, before = NORMAL_90 * calibrated.told, np.full(len(names), NORMAL_90)
    end = max(NORMAL_90, float((np.abs(steps) + half).max()))
    dots = (
        Dots("before the log", LOG, 0.0 * before, places, -before, before),
        Dots("after it", ROBOT, steps, places, steps - half, steps + half),
    )
    across = ChartAxis(
        "standard deviations of the belief before, from its middle; 90 % intervals", -end, end
    )
    up = ChartAxis("", 0.0, len(names), names=names)
    save_panels(path, [Chart("", across, up, dots, height=60 + 22 * len(names))])
