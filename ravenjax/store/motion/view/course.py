"""A tip before and after: what a picture of a recording is drawn from."""

from __future__ import annotations

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True, eq=False)
class TipCourse:
    """One arm. Times are seconds in the recording, positions m in frame 0."""

    arm: str
    recorded_s: np.ndarray  # [T]
    recorded: np.ndarray  # [T, 3] every sample of the file
    replayed_s: (
        np.ndarray
    )  # [ticks] where in the recording the hands are in each millisecond of the campaign
    replayed: np.ndarray  # [ticks, 3]; no ticks where nothing can be replayed
    outside: tuple[tuple[float, float], ...]  # stretches that the arm cannot reach
    gaps: tuple[tuple[float, float], ...]  # stretches without samples
    spikes: tuple[float, ...]
