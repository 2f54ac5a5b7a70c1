"""Makes the tables of a calibration: following errors of the robots, and the parameters before and
after the log.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ravenjax.analyses.calibration.calibrate import Calibration, FollowingError
from ravenjax.robots.raven2.arms import JOINTS

PER_UNIT = np.array((180.0 / np.pi,) * 2 + (1e3,) + (180.0 / np.pi,) * 4)
"""Factors from rad and m to deg and mm for display."""
UNITS = ("deg", "deg", "mm", "deg", "deg", "deg", "deg")
TOLD = 0.5
"""A parameter counts as determined if the log at least halves its spread."""


class Rows(NamedTuple):
    """A table."""

    title: str
    columns: tuple[str, ...]
    cells: list[tuple[str, ...]]


def by_joint(title: str, rows: Sequence[FollowingError], joints: Sequence[int]) -> Rows:
    """Return root mean square following errors of the log and of each model, one row per joint,
    with each model's ratio to the log.
    """
    log, *models = rows
    cells = [
        (
            f"{JOINTS[j].replace('_', ' ')}, {UNITS[j]}",
            f"{log.following[j] * PER_UNIT[j]:.3f}",
            *(
                f"{one.following[j] * PER_UNIT[j]:.3f}"
                f" ({one.following[j] / log.following[j]:.2f})\noff"
                f" {one.residual[j] * PER_UNIT[j]:.3f}"
                for one in models
            ),
        )
        for j in joints
    ]
    return Rows(title, ("joint", *(one.model for one in rows)), cells)


def tabulate_parameters(title: str, calibrated: Calibration) -> Rows:
    """Return every unknown before and after the log, its 90 % interval, and the share of its spread
    that the log leaves.
    """
    low, high = calibrated.interval
    rows = zip(
        calibrated.unknowns,
        calibrated.before,
        calibrated.after,
        low,
        high,
        calibrated.told,
        strict=True,
    )
    cells = [
        (
            one.path,
            f"{before:.4g}",
            f"{after:.3g}",
            f"{least:.3g}",
            f"{most:.3g}",
            f"{left:.2f}" + ("" if left <= TOLD else " (not told)"),
        )
        for one, before, after, least, most, left in rows
    ]
    return Rows(title, ("parameter", "before", "after", "5 %", "95 %", "spread left"), cells)
