"""Measures paths and speed profiles of a point in space: length, economy, smoothness.

docs/how-to/training-session-tools.md names the sources.
"""

import math
from collections.abc import Sequence

import numpy as np

RATE_HZ, CUTOFF_HZ = 100.0, 10.0
# Balasubramanian et al. 2015: cut-off; smallest relative amplitude that counts; doublings by zeros.
_SPARC_HZ, _SPARC_MIN_SHARE, _SPARC_PADS = 10.0, 0.05, 4


def path_length(points: np.ndarray) -> float:
    """Return the length of a path of points [T, 3], in their unit."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def path_economy(paths: Sequence[np.ndarray]) -> float | None:
    """Return the sum of the straight distances of paths [T, 3], divided by the sum of their
    lengths; None if nothing moves. 1: all paths are straight.
    """
    length = sum(map(path_length, paths))
    straight = sum(float(np.linalg.norm(path[-1] - path[0])) for path in paths)
    return straight / length if length > 0 else None


def tip_speed(points: np.ndarray) -> np.ndarray:
    """Return the speed [T] of points [T, 3] sampled at `RATE_HZ`, in their unit per second."""
    if len(points) < 2:
        return np.zeros(len(points))
    return np.linalg.norm(np.gradient(points, 1 / RATE_HZ, axis=0), axis=1)


def spectral_arc_length(profile: np.ndarray, rate_hz: float = RATE_HZ) -> float | None:
    """Return the spectral arc length (SPARC) of a speed profile [T]; None if nothing moves. It is
    the negative length of the spectrum's curve. The smoother the motion, the nearer to 0.
    """
    if len(profile) < 2 or not np.any(profile):
        return None
    # Zeros make the profile as long as the next power of two, and then twice as long _SPARC_PADS
    # times, so that the spectrum has finer steps of frequency.
    size = 2 ** (math.ceil(math.log2(len(profile))) + _SPARC_PADS)
    magnitude = np.abs(np.fft.rfft(profile, size))
    frequency = np.arange(len(magnitude)) * rate_hz / size
    is_below = frequency <= _SPARC_HZ
    frequency, magnitude = frequency[is_below], magnitude[is_below] / magnitude.max()
    # The curve ends at the last frequency with an amplitude that counts.
    counted = np.flatnonzero(magnitude >= _SPARC_MIN_SHARE)
    used = slice(counted[0], counted[-1] + 1)
    frequency, magnitude = frequency[used], magnitude[used]
    if len(frequency) < 2:
        return None
    steps = np.diff(frequency) / (frequency[-1] - frequency[0])
    return -float(np.hypot(steps, np.diff(magnitude)).sum())


def log_dimensionless_jerk(profile: np.ndarray, rate_hz: float = RATE_HZ) -> float | None:
    """Return the log dimensionless jerk of a speed profile [T]; None if nothing moves. It is
    -ln(integral of the squared jerk * duration^3 / peak speed^2).
    """
    # The jerk is the second derivative of the speed. Its square is integrated over time.
    squared_jerk = float(np.square(np.diff(profile, 2) * rate_hz**2).sum()) / rate_hz
    if squared_jerk <= 0:
        return None
    duration = (len(profile) - 1) / rate_hz
    return -math.log(duration**3 / float(profile.max()) ** 2 * squared_jerk)


def resample_path(ms: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return points [T, 3] at times ms [T], resampled at `RATE_HZ` and low-passed. The filter runs
    forward and backward, so that it delays nothing.
    """
    # The import takes half a second.
    from scipy import signal

    # The small number lets the last point be included.
    times = np.arange(ms[0], ms[-1] + 1e-9, 1e3 / RATE_HZ)
    even = np.stack([np.interp(times, ms, axis) for axis in points.T], axis=1)
    # The filter needs 16 points or more. A shorter path is not filtered.
    if len(even) < 16:
        return even
    sections = signal.butter(2, CUTOFF_HZ, fs=RATE_HZ, output="sos")
    return np.asarray(signal.sosfiltfilt(sections, even, axis=0))
