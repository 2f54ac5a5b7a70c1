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
MOST_SPREAD_LEFT = 0.5
"""A parameter counts as determined if its spread after the log is at most this share of before."""


class Rows(NamedTuple):
    """A table."""

    title: str
    columns: tuple[str, ...]
    cells: list[tuple[str, ...]]


def by_joint(title: str, rows: Sequence[FollowingError], joints: Sequence[int]) -> Rows:
    """Return one row per joint: the root mean square following error of the log and of each model.

    A model's cell also holds its ratio to the log's error, and how far the model is off the log.
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
    """Return one row for each parameter that the log was asked for.

    A row holds the value before and after the fit, the ends of the 90 % interval, and the spread
    after the log as a share of the spread before. A share above MOST_SPREAD_LEFT has a mark.
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
            unknown.path,
            f"{before:.4g}",
            f"{after:.3g}",
            f"{lower:.3g}",
            f"{upper:.3g}",
            f"{spread_left:.2f}" + ("" if spread_left <= MOST_SPREAD_LEFT else " (not determined)"),
        )
        for unknown, before, after, lower, upper, spread_left in rows
    ]
    return Rows(title, ("parameter", "before", "after", "5 %", "95 %", "spread left"), cells)
