"""Curves of a recording for its figures: over the session's time without pauses, thinned so that
no peak is lost.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ravenjax.train.recording.reader import Recording

POINTS = 900
"""Of a drawn curve."""


class Course:
    """What the figures draw of a recording: channels over the session's own time, pauses left
    out.
    """

    def __init__(
        self,
        recording: Recording,
        threshold_mm: float | None = None,
        limit_mm: float | None = None,
        blinded: bool = False,
    ) -> None:
        """threshold_mm: of the cue; limit_mm: of hazards; None: not known. blinded: hide whether
        the cue was felt.
        """
        ticks = recording["session_tick"]
        keep = np.diff(ticks, append=ticks[-1:] + 1) > 0
        self.rows, self.layout = recording.rows[keep], recording.layout
        self.ms = ticks[keep].astype(float)
        self.threshold_mm, self.limit_mm, self.blinded = threshold_mm, limit_mm, blinded

    def channel(self, name: str) -> np.ndarray:
        """One channel, [T] or [T, k]."""
        values = self.rows[:, self.layout.places[name]]
        return values[:, 0] if values.shape[1] == 1 else values

    def worst(self, name: str, arms: Sequence[str]) -> np.ndarray:
        """The greatest of the arms' values; the size of what is a vector."""
        channels = [self.channel(f"{arm}/{name}") for arm in arms]
        return np.max(
            [np.linalg.norm(one, axis=1) if one.ndim > 1 else one for one in channels], axis=0
        )


def peaks(
    time: np.ndarray, values: np.ndarray, points: int = POINTS
) -> tuple[np.ndarray, np.ndarray]:
    """A curve thinned so that no peak is lost: the greatest value of each stretch, at its own
    time.
    """
    finite = np.where(np.isfinite(values), values, 0.0).astype(float)
    stride = -(-len(time) // points)
    if stride == 1:
        return time, finite
    starts = range(0, len(time), stride)
    best = [start + int(finite[start : start + stride].argmax()) for start in starts]
    indices = np.unique([0, *best, len(time) - 1])
    return time[indices], finite[indices]
