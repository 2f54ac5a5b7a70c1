"""Measures of how somebody moved: path, economy, smoothness, idle time, use of both hands.

Of the true tips, resampled at `RATE_HZ` and low-passed at `CUTOFF_HZ`, while the pedal is down and
the session runs. A *stretch* is such a time without a gap, a *movement* the part of it between two
targets (all of it without targets).

- Path length and economy of motion (straight ways over the way gone): Oropesa et al., EVA:
  laparoscopic instrument tracking based on endoscopic video analysis for psychomotor skills
  assessment, Surg. Endosc. 27 (2013).
- Spectral arc length: Balasubramanian, Melendez-Calderon, Burdet, A robust and sensitive metric for
  quantifying movement smoothness, IEEE Trans. Biomed. Eng. 59 (2012); with the adaptive cut-off of
  Balasubramanian, Melendez-Calderon, Roby-Brami, Burdet, On the analysis of movement smoothness, J.
  NeuroEng. Rehabil. 12:112 (2015).
- Log dimensionless jerk of the speed: the paper of 2015.
- Idle time, both tips nearly still: D'Angelo et al., Idle time: an underdeveloped performance
  metric for assessing surgical skill, Am. J. Surg. 209 (2015).
- Bimanual dexterity, the correlation of the two tips' speeds: Hofstad et al., A study of
  psychomotor skills in minimally invasive surgery, Surg. Endosc. 27 (2013); beside it the share of
  time in which both move.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from ravenjax.train.debrief.course import Course

RATE_HZ, CUTOFF_HZ = 100.0, 10.0
IDLE_MM_S = 1.0
"""A tip that is slower is still."""
SHORTEST_S = 0.5
"""Of a movement whose smoothness is measured."""
# Balasubramanian et al. 2015: cut-off, amplitude, zero-padding.
_SPARC_HZ, _SPARC_LEAST, _SPARC_PADS = 10.0, 0.05, 4
RUNNING = 1  # of `frame.PHASES`


@dataclass(frozen=True)
class ArmDexterity:
    """How one tip was moved; NaN where there was nothing to measure."""

    path_mm: float
    economy: float  # 0 to 1, of movements between targets; NaN without targets
    sparc: float  # median of the movements, below 0; nearer to 0 is smoother
    log_jerk: float  # log dimensionless jerk, median; likewise
    movements: int  # whose smoothness was measured


@dataclass(frozen=True)
class Dexterity:
    """Measures of a session."""

    driven_s: float  # pedal down, session running
    idle: float  # share of that in which no tip moves
    both: float  # share in which both move; NaN with one arm
    correlation: float  # of the two tips' speeds; NaN with one arm
    arms: dict[str, ArmDexterity]

    def plain(self) -> dict[str, Any]:
        """For JSON: null where there was nothing to measure."""

        def without_nan(value: Any) -> Any:
            if isinstance(value, dict):
                return {name: without_nan(part) for name, part in value.items()}
            return None if isinstance(value, float) and math.isnan(value) else value

        return without_nan(asdict(self))


class ArmContact(NamedTuple):
    """How hard one instrument pressed on tissue, vessel and the other instrument."""

    arm: str
    peak_n: float  # N, largest force of all that it touched
    impulse_n_s: float  # N s, that force over time
    vessel_n: float  # N, largest force of the vessel
    between_n: float  # N, largest force of the other instrument


def contact(course: Course) -> list[ArmContact]:
    """Of each arm of a recorded session; its rows are ms."""
    out = []
    for arm in course.layout.arms:
        force = np.linalg.norm(np.asarray(course.channel(f"{arm}/contact"), float), axis=1)
        parts = (float(course.channel(f"{arm}/{name}").max()) for name in ("vessel_n", "between_n"))
        out.append(ArmContact(arm, float(force.max()), float(force.sum() * 1e-3), *parts))
    return out


def measure(course: Course) -> Dexterity:
    """The measures of a recorded session."""
    arms = course.layout.arms
    driven = (course.channel("pedal") > 0) & (course.channel("phase") == RUNNING)
    cuts = np.flatnonzero((np.diff(driven.astype(int)) != 0) | (np.diff(course.ms) > 1.5)) + 1
    edges = [0, *cuts.tolist(), len(driven)]
    stretches = [(a, b) for a, b in itertools.pairwise(edges) if b - a > 1 and driven[a]]
    points = {
        arm: [
            resampled(course.ms[first:last], course.channel(f"{arm}/tip")[first:last])
            for first, last in stretches
        ]
        for arm in arms
    }
    speeds = [np.concatenate([*map(speed, points[arm]), np.zeros(0)]) for arm in arms]
    moving = [each > IDLE_MM_S * 1e-3 for each in speeds]
    is_any, is_two = len(speeds[0]) > 0, len(arms) == 2 and len(speeds[0]) > 0
    return Dexterity(
        driven_s=sum(last - first for first, last in stretches) * 1e-3,
        idle=float(np.mean(~np.any(moving, axis=0))) if is_any else math.nan,
        both=float(np.mean(moving[0] & moving[1])) if is_two else math.nan,
        correlation=correlation(*speeds) if is_two else math.nan,
        arms={arm: _of_arm(course, arm, stretches, points[arm]) for arm in arms},
    )


def path_length(points: np.ndarray) -> float:
    """Length of a way of points [T, 3], in their unit."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def economy(ways: Sequence[np.ndarray]) -> float:
    """Straight distances from the first to the last point of each way [T, 3], over what was
    gone; NaN for 0.
    """
    gone = sum(map(path_length, ways))
    straight = sum(float(np.linalg.norm(way[-1] - way[0])) for way in ways)
    return straight / gone if gone > 0 else math.nan


def speed(points: np.ndarray, rate_hz: float = RATE_HZ) -> np.ndarray:
    """Speed [T] of points [T, 3] that come at a rate, in their unit a second."""
    if len(points) < 2:
        return np.zeros(len(points))
    return np.linalg.norm(np.gradient(points, 1 / rate_hz, axis=0), axis=1)


def spectral_arc_length(profile: np.ndarray, rate_hz: float = RATE_HZ) -> float:
    """Spectral arc length of a speed profile [T] (Balasubramanian et al. 2015); NaN where
    nothing moves.
    """
    if len(profile) < 2 or not np.any(profile):
        return math.nan
    size = 2 ** (math.ceil(math.log2(len(profile))) + _SPARC_PADS)
    magnitude = np.abs(np.fft.rfft(profile, size))
    frequency = np.arange(len(magnitude)) * rate_hz / size
    below = frequency <= _SPARC_HZ
    frequency, magnitude = frequency[below], magnitude[below] / magnitude.max()
    loud = np.flatnonzero(magnitude >= _SPARC_LEAST)
    frequency, magnitude = (values[loud[0] : loud[-1] + 1] for values in (frequency, magnitude))
    if len(frequency) < 2:
        return math.nan
    return -float(
        np.hypot(np.diff(frequency) / (frequency[-1] - frequency[0]), np.diff(magnitude)).sum()
    )


def log_dimensionless_jerk(profile: np.ndarray, rate_hz: float = RATE_HZ) -> float:
    """Log dimensionless jerk of a speed profile [T] (Balasubramanian et al. 2015); NaN where
    nothing moves.

    Minus the logarithm of duration cubed over the peak squared, times the integral of the speed's
    second derivative squared.
    """
    if len(profile) < 5 or not np.any(profile):
        return math.nan
    jerk = np.diff(profile, 2) * rate_hz**2
    duration = (len(profile) - 1) / rate_hz
    scale = duration**3 / float(profile.max()) ** 2
    total = float(np.square(jerk).sum()) / rate_hz
    return -math.log(scale * total) if total > 0 else math.nan


def correlation(one: np.ndarray, other: np.ndarray) -> float:
    """Pearson's, of two tips' speeds [T]; NaN where one does not vary."""
    if len(one) < 2 or one.std() == 0 or other.std() == 0:
        return math.nan
    return float(np.corrcoef(one, other)[0, 1])


def resampled(ms: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points [T, 3] at times ms, at `RATE_HZ` and low-passed without a shift in time
    (Butterworth, both ways).
    """
    from scipy import signal  # half a second

    times = np.arange(ms[0], ms[-1] + 1e-9, 1e3 / RATE_HZ)
    even = np.stack([np.interp(times, ms, axis) for axis in points.T], axis=1)
    if len(even) < 16:  # shorter than the filter's padding
        return even
    sections = signal.butter(2, CUTOFF_HZ, fs=RATE_HZ, output="sos")
    return np.asarray(signal.sosfiltfilt(sections, even, axis=0))


def _of_arm(
    course: Course, arm: str, stretches: Sequence[tuple[int, int]], points: Sequence[np.ndarray]
) -> ArmDexterity:
    tip, target = course.channel(f"{arm}/tip"), course.channel("target")
    ways, smooth = [], []
    for first, last in stretches:
        marks = first + 1 + np.flatnonzero(np.diff(target[first:last]))
        for a, b in itertools.pairwise([first, *marks.tolist(), last]):
            if (b - a) * 1e-3 < SHORTEST_S:
                continue
            way = resampled(course.ms[a:b], tip[a:b])
            profile = speed(way)
            if profile.max() <= IDLE_MM_S * 1e-3:
                continue
            smooth.append((spectral_arc_length(profile), log_dimensionless_jerk(profile)))
            if target[a] >= 0:
                ways.append(way)
    sparc, jerk = np.nanmedian(smooth, axis=0) if smooth else (math.nan, math.nan)
    path_mm = 1e3 * sum(map(path_length, points))
    return ArmDexterity(path_mm, economy(ways), float(sparc), float(jerk), len(smooth))
