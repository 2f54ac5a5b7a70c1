"""Gives the recording of a session over the session's own time, without pauses."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ravenjax.train.recording.reader import Recording


class Course:
    """Channels of a recording, without rows in which the session's time stood still."""

    def __init__(self, recording: Recording) -> None:
        ticks = recording["session_tick"]
        runs = np.diff(ticks, append=ticks[-1:] + 1) > 0
        self.rows, self.layout = recording.rows[runs], recording.layout
        self.ms = ticks[runs].astype(float)

    def channel(self, name: str) -> np.ndarray:
        """Return a channel, [T] or [T, k]."""
        values = self.rows[:, self.layout.places[name]]
        return values[:, 0] if values.shape[1] == 1 else values

    def worst(self, name: str, arms: Sequence[str]) -> np.ndarray:
        """Return the greatest of the arms' values. The value of a vector is its length."""
        channels = [self.channel(f"{arm}/{name}") for arm in arms]
        sizes = [np.linalg.norm(one, axis=1) if one.ndim > 1 else one for one in channels]
        return np.max(sizes, axis=0)
