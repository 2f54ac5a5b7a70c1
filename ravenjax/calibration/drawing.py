"""The picture of a calibration: following errors of the log and of the calibrated robot, joint by joint."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from ravenjax.calibration.log import JointLog
from ravenjax.calibration.parameters import JOINTS
from ravenjax.calibration.tables import PER_UNIT, UNITS
from ravenjax.document.figure_style import STYLE
from ravenjax.store.files import write_aside


def save(path: Path, log: JointLog, replayed: np.ndarray, until: int) -> None:
    """Write the SVG. replayed: [n, 7] of the calibrated robot; until: cycle up to which was fitted."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(10.0, 1.0 + 1.3 * len(log.joints)), layout="constrained")
        _draw(figure, log, replayed, until)
        write_aside(path, lambda target: figure.savefig(target, format="svg", metadata={"Date": None}))


def _draw(figure: Any, log: JointLog, replayed: np.ndarray, until: int) -> None:
    axes = figure.subplots(len(log.joints), 1, sharex=True, squeeze=False)[:, 0]
    seconds, desired = log.cycles * 1e-3, log.desired[log.cycles]
    for axis, joint in zip(axes, log.joints, strict=True):
        for joints, colour, label in ((log.measured, "#1b1f24", "log"), (replayed, "#d9571b", "calibrated robot")):
            error = (joints[:, joint] - desired[:, joint]) * PER_UNIT[joint]
            axis.plot(seconds, error, color=colour, linewidth=0.8, label=label)
        axis.axvline(until * 1e-3, color="#5b6470", linewidth=0.8, linestyle="--")
        axis.set_ylabel(f"{JOINTS[joint].replace('_', ' ')}, {UNITS[joint]}")
    axes[0].set_title(
        "Following error, measured minus desired; right of the dashed line nothing was fitted", fontsize=10
    )
    axes[0].legend(loc="upper right", fontsize=8, ncols=2)
    axes[-1].set_xlabel("s")
    figure.align_ylabels(axes)
