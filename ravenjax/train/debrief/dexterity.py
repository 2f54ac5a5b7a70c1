"""Measures an operator's motion: path, economy, smoothness, idle time, use of both hands.

The measures use the true tips while the pedal is down and the session runs, resampled at `RATE_HZ`
and low-passed at `CUTOFF_HZ`. A *stretch* is a period of this time without a gap. A *movement* is
the part of a stretch between two targets, or the whole stretch if the task has no targets.
docs/how-to/training-session-tools.md names the sources.
"""

import itertools
import math
import statistics
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ravenjax.train.protocol import RUNNING, Json
from ravenjax.train.recording.reader import Recording, sessions_beside

KEY = "dexterity"
"""Key of the measures in the summary of session.json."""
RATE_HZ, CUTOFF_HZ = 100.0, 10.0
IDLE_MM_S = 1.0
"""A tip below this speed counts as still."""
SHORTEST_S = 0.5
"""Shorter movements have no smoothness."""
# Balasubramanian et al. 2015: cut-off, least amplitude, doublings of the length by zeros.
_SPARC_HZ, _SPARC_LEAST, _SPARC_PADS = 10.0, 0.05, 4


def measure_dexterity(course: Recording) -> Json:
    """Return the measures of a recorded session, for session.json.

    A value is null if there was nothing to measure. `both` and `speed_correlation` are null with
    one arm, `path_economy` without targets.
    """
    driven = (course["pedal"] > 0) & (course["phase"] == RUNNING)
    cuts = np.flatnonzero((np.diff(driven.astype(int)) != 0) | (np.diff(course.ms) > 1.5)) + 1
    edges = [0, *cuts.tolist(), len(driven)]
    stretches = [(a, b) for a, b in itertools.pairwise(edges) if b - a > 1 and driven[a]]
    measures: Json = {
        "driven_s": sum(last - first for first, last in stretches) * 1e-3,
        **dict.fromkeys(("idle", "both", "correlation")),
        "arms": {},
    }
    speeds = []
    for arm in course.layout.arms:
        tip = course[f"{arm}/tip"]
        ways = [resample_path(course.ms[first:last], tip[first:last]) for first, last in stretches]
        speeds.append(np.concatenate([*map(tip_speed, ways), np.zeros(0)]))
        path_mm = 1e3 * sum(map(path_length, ways))
        measures["arms"][arm] = {"path_mm": path_mm} | _movements(course, tip, stretches)
    if len(speeds[0]):
        moving = np.array(speeds) > IDLE_MM_S * 1e-3
        measures["idle"] = float(np.mean(~moving.any(axis=0)))
        if len(speeds) == 2:
            measures["both"] = float(np.mean(moving.all(axis=0)))
            varies = min(speed.std() for speed in speeds) > 0
            measures["correlation"] = float(np.corrcoef(*speeds)[0, 1]) if varies else None
    return measures


def measure_contact(course: Recording) -> dict[str, dict[str, float]]:
    """Return the largest contact forces, N, and the impulse, N s, of each arm."""
    measures = {}
    for arm in course.layout.arms:
        force = np.linalg.norm(course[f"{arm}/contact"].astype(float), axis=1)
        # A row lasts one millisecond, so the sum of forces times 1e-3 s is the impulse.
        peaks = {name: course[f"{arm}/{name}"].max() for name in ("vessel_n", "between_n")}
        sizes = {"peak_n": force.max(), "impulse_n_s": force.sum() * 1e-3} | peaks
        measures[arm] = {name: float(size) for name, size in sizes.items()}
    return measures


def read_attempts(folder: Path) -> list[Json]:
    """Return measures of the same person's earlier sessions of the scenario, and of this one.

    They are read from the folders beside `folder`. The list is empty if the person is not named.
    A missing number is None.
    """
    sessions = sessions_beside(folder.parent)
    present = sessions.get(folder.name)
    if present is None or not present.participant:
        return []
    attempts = []
    for session in sessions.values():
        key = session.participant, session.scenario
        is_later = session.order > present.order
        if key != (present.participant, present.scenario) or is_later or KEY not in session.summary:
            continue
        hazards = session.summary.get("hazards") or {}
        arms = session.summary[KEY].get("arms", {}).values()
        smooth = [arm["sparc"] for arm in arms if arm.get("sparc") is not None]
        attempts.append(
            {
                "name": session.path.name,
                "score of 100": hazards.get("score"),
                "reaction, ms": hazards.get("median_reaction_ms"),
                "path, mm": sum(arm.get("path_mm") or 0.0 for arm in arms) if arms else None,
                "smoothness (SPARC)": statistics.fmean(smooth) if smooth else None,
            }
        )
    return attempts


def path_length(points: np.ndarray) -> float:
    """Return the length of a path of points [T, 3], in their unit."""
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def path_economy(ways: Sequence[np.ndarray]) -> float | None:
    """Return the straight distances of paths [T, 3] divided by their lengths, or None."""
    gone = sum(map(path_length, ways))
    straight = sum(float(np.linalg.norm(way[-1] - way[0])) for way in ways)
    return straight / gone if gone > 0 else None


def tip_speed(points: np.ndarray) -> np.ndarray:
    """Return the speed [T] of points [T, 3] sampled at `RATE_HZ`, in their unit per second."""
    if len(points) < 2:
        return np.zeros(len(points))
    return np.linalg.norm(np.gradient(points, 1 / RATE_HZ, axis=0), axis=1)


def spectral_arc_length(profile: np.ndarray, rate_hz: float = RATE_HZ) -> float | None:
    """Return the spectral arc length of a speed profile [T]; None if nothing moves."""
    if len(profile) < 2 or not np.any(profile):
        return None
    size = 2 ** (math.ceil(math.log2(len(profile))) + _SPARC_PADS)
    magnitude = np.abs(np.fft.rfft(profile, size))
    frequency = np.arange(len(magnitude)) * rate_hz / size
    below = frequency <= _SPARC_HZ
    frequency, magnitude = frequency[below], magnitude[below] / magnitude.max()
    loud = np.flatnonzero(magnitude >= _SPARC_LEAST)
    frequency, magnitude = (values[loud[0] : loud[-1] + 1] for values in (frequency, magnitude))
    if len(frequency) < 2:
        return None
    steps = np.diff(frequency) / (frequency[-1] - frequency[0])
    return -float(np.hypot(steps, np.diff(magnitude)).sum())


def log_dimensionless_jerk(profile: np.ndarray, rate_hz: float = RATE_HZ) -> float | None:
    """Return the log dimensionless jerk of a speed profile [T]; None if nothing moves."""
    total = float(np.square(np.diff(profile, 2) * rate_hz**2).sum()) / rate_hz
    duration = (len(profile) - 1) / rate_hz
    return -math.log(duration**3 / float(profile.max()) ** 2 * total) if total > 0 else None


def resample_path(ms: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Resample points [T, 3] at times ms to `RATE_HZ`, low-passed forward and backward."""
    # The import takes half a second.
    from scipy import signal

    times = np.arange(ms[0], ms[-1] + 1e-9, 1e3 / RATE_HZ)
    even = np.stack([np.interp(times, ms, axis) for axis in points.T], axis=1)
    # The filter needs this number of points at each end.
    if len(even) < 16:
        return even
    sections = signal.butter(2, CUTOFF_HZ, fs=RATE_HZ, output="sos")
    return np.asarray(signal.sosfiltfilt(sections, even, axis=0))


def _movements(course: Recording, tip: np.ndarray, stretches: Sequence[tuple[int, int]]) -> Json:
    # Measures of each movement from one target to the next, and their medians.
    target = course["target"]
    ways, arc_lengths, jerks = [], [], []
    for first, last in stretches:
        marks = first + 1 + np.flatnonzero(np.diff(target[first:last]))
        for a, b in itertools.pairwise([first, *marks.tolist(), last]):
            if (b - a) * 1e-3 < SHORTEST_S:
                continue
            way = resample_path(course.ms[a:b], tip[a:b])
            profile = tip_speed(way)
            if profile.max() <= IDLE_MM_S * 1e-3:
                continue
            arc_lengths.append(spectral_arc_length(profile))
            jerks.append(log_dimensionless_jerk(profile))
            if target[a] >= 0:
                ways.append(way)
    measures: Json = {"economy": path_economy(ways), "movements": len(jerks)}
    for name, values in (("sparc", arc_lengths), ("log_jerk", jerks)):
        known = [x for x in values if x is not None]
        measures[name] = statistics.median(known) if known else None
    return measures
