"""How well the calibrated robot predicts the part of a log that nothing was fitted to, beside
other models of it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class FollowingError(NamedTuple):
    """Root mean squares over one part of a log, [7]; rad and m, nan where the log has no such
    joint.
    """

    model: str
    following: np.ndarray  # of measured or replayed minus desired joints
    residual: np.ndarray  # of replayed minus measured joints


def following(
    log: str, measured: np.ndarray, desired: np.ndarray, predictions: dict[str, np.ndarray]
) -> list[FollowingError]:
    """The log's own following error, then that of each model's replay; arrays [n, 7]."""
    there = np.isnan(measured)
    rows = [FollowingError(log, _rms(measured - desired, there), np.zeros(measured.shape[-1]))]
    for model, joints in predictions.items():
        rows.append(
            FollowingError(model, _rms(joints - desired, there), _rms(joints - measured, there))
        )
    return rows


def _rms(errors: np.ndarray, absent: np.ndarray) -> np.ndarray:
    count = (~absent).sum(axis=0)
    total = (np.where(absent, 0.0, errors) ** 2).sum(axis=0)
    return np.sqrt(np.where(count > 0, total / count.clip(1), np.nan))
