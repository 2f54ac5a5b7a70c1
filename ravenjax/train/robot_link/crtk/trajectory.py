"""The way of `move_jp`: from joints to joints without a jerk, all at once, as fast as the
slowest joint may.
"""

from __future__ import annotations

import math

import numpy as np

_DEG = math.pi / 180
FASTEST = np.array([5 * _DEG, 5 * _DEG, 0.02, 15 * _DEG, 15 * _DEG, 15 * _DEG, 15 * _DEG])
"""rad/s, insertion m/s: what the public CRTK clients of the Raven keep to."""
STRONGEST = np.array([1.0, 1.0, 0.1, 1.0, 1.0, 1.0, 1.0])
"""rad/s^2, A_MAX of raven2's `defines.h`; insertion m/s^2, ours."""
_PEAK_SPEED = 1.875  # of 10 s^3 - 15 s^4 + 6 s^5, over its time
_PEAK_ACCELERATION = 10 / math.sqrt(3)


class Trajectory:
    """Minimum-jerk motion in joint space."""

    def __init__(self, start: np.ndarray, goal: np.ndarray, begins_ms: float) -> None:
        """start, goal: [7], rad, insertion m."""
        self._start, self.goal, self._begins_ms = start, goal, begins_ms
        way = np.abs(goal - start)
        speed, acceleration = (
            _PEAK_SPEED * way / FASTEST,
            np.sqrt(_PEAK_ACCELERATION * way / STRONGEST),
        )
        self.seconds = float(max(speed.max(), acceleration.max()))

    def at(self, now_ms: float) -> tuple[np.ndarray, bool]:
        """Joints at this time, and whether the goal is reached."""
        s = 1.0 if self.seconds == 0 else min((now_ms - self._begins_ms) * 1e-3 / self.seconds, 1.0)
        s = max(s, 0.0)
        share = s**3 * (10 + s * (6 * s - 15))
        return self._start + share * (self.goal - self._start), s == 1.0
