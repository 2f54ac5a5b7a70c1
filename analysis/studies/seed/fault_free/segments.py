"""Fault-free segments of the training-simulator paper: tip error of one motion at one teleoperation
scale.

Tip error is what the cue sees, the distance from the tip that the control software measures to the
nominal model's. Two other readings of the paper stand beside it: the true tip's distance, and the
measured one if both had begun at the same place (its vector at rest taken off).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from studies.framework.series import Row, Series, rises

REST_TICKS = 500
"""The hand rests so long at the beginning of every generated motion, pedal down from tick 200
on.
"""
DRAWN_EVERY = 20
"""Ticks between drawn points; each is the largest error among them."""


@dataclasses.dataclass(frozen=True, eq=False)
class RunSegment:
    """What one run shows from the first motion on, until its end or the robot's stop."""

    group: str  # of the campaign: what is otherwise than modelled
    scale: float
    peak_mm: float
    mean_mm: float
    true_mean_mm: float  # of the true tip
    zeroed_mean_mm: float  # of the measured tip, its offset at rest taken off
    rest_mm: float  # tip error at rest, before the motion
    pulses: int  # of the cue
    stop_ms: int  # when the robot stopped by itself, -1: never
    drawn_mm: np.ndarray  # tip error, one number each DRAWN_EVERY ticks


def segment(row: Row, series: Series) -> RunSegment:
    """Measure a run: its row of the result table, and its series."""
    stop = int(row["check_estop_first_ms"])
    end = len(series["tip_error_mm"]) if stop < 0 else stop
    moving = slice(REST_TICKS, max(end, REST_TICKS + 1))
    error = series["tip_error_mm"]
    apart = (series["position"] - series["model_position"]) * 1e3
    zeroed = np.linalg.norm(apart - apart[REST_TICKS - 1], axis=1)
    true = np.linalg.norm(series["tip"] - series["model_position"], axis=1) * 1e3
    whole = len(error[moving]) // DRAWN_EVERY * DRAWN_EVERY
    return RunSegment(
        group=str(row["group"]),
        scale=float(row["param:operator.scale"]),
        peak_mm=float(error[moving].max()),
        mean_mm=float(error[moving].mean()),
        true_mean_mm=float(true[moving].mean()),
        zeroed_mean_mm=float(zeroed[moving].mean()),
        rest_mm=float(error[REST_TICKS - 1]),
        pulses=len(rises(series["cue_force"][moving] > 0.0)),
        stop_ms=stop,
        drawn_mm=error[moving][:whole].reshape(-1, DRAWN_EVERY).max(axis=1).astype(np.float32),
    )


@dataclasses.dataclass(frozen=True)
class Growth:
    """A straight line through a quantity at several scales."""

    slope: float  # mm per unit of scale
    at_zero: float  # mm
    explained: float  # share of the variance, R2


def growth(scales: Sequence[float], values: Sequence[float]) -> Growth:
    """Least squares; at least three scales."""
    x, y = np.asarray(scales, float), np.asarray(values, float)
    slope, at_zero = np.polyfit(x, y, 1)
    rest, about = y - slope * x - at_zero, y - y.mean()
    return Growth(
        float(slope),
        float(at_zero),
        float(1.0 - rest @ rest / (about @ about)) if about.any() else 1.0,
    )


def spread(values: Iterable[float]) -> tuple[float, float]:
    """Least and largest."""
    every = list(values)
    return min(every), max(every)
