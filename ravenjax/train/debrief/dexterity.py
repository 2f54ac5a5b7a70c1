"""Measures an operator's motion: path, economy, smoothness, idle time, use of both hands.

The measures use the true tips while the pedal is down, the session runs, and the operator drives
the real robot, as `motion.resample_path` returns them. A *stretch* is a period of this time without
a gap. A *movement* is the part of a stretch between two targets, or the whole stretch if the task
has no targets. docs/how-to/training-session-tools.md names the sources.
"""

import itertools
import statistics
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ravenjax.stats import motion
from ravenjax.train.protocol import REAL, RUNNING, Json
from ravenjax.train.recording.reader import Recording, find_sessions

KEY = "dexterity"  # Key of the measures in the summary of session.json
IDLE_MM_S = 1.0
"""A tip below this speed counts as still."""
MIN_MOVEMENT_S = 0.5  # Shorter movements have no smoothness


def measure_dexterity(course: Recording) -> Json:
    """Return the measures of a recorded session, for session.json. "idle" and "both" are shares of
    the driven time in which no tip moves, or both tips. A value is None if there was nothing to
    measure: "both" and "correlation" (of the tips' speeds) with one arm, "economy" without targets.
    """
    driven = (course["pedal"] > 0) & (course["phase"] == RUNNING) & (course["view"] == REAL)
    # A stretch is a range of rows with driving. Rows are 1 ms apart unless some are missing.
    has_gap = np.diff(course.ms) > 1.5
    cuts = np.flatnonzero(np.diff(driven) | has_gap) + 1
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
        paths = [motion.resample_path(course.ms[a:b], tip[a:b]) for a, b in stretches]
        # `np.concatenate` needs at least one array, also for a session without a stretch.
        speeds.append(np.concatenate([*map(motion.tip_speed, paths), np.zeros(0)]))
        measures["arms"][arm] = {
            "path_mm": 1e3 * sum(map(motion.path_length, paths)),
            **_movements(course, tip, stretches),
        }
    if len(speeds[0]):
        moving = np.array(speeds) > IDLE_MM_S * 1e-3
        measures["idle"] = float(np.mean(~moving.any(axis=0)))
        if len(speeds) == 2:
            measures["both"] = float(np.mean(moving.all(axis=0)))
            if min(speed.std() for speed in speeds) > 0:
                measures["correlation"] = float(np.corrcoef(*speeds)[0, 1])
    return measures


def measure_contact(course: Recording) -> dict[str, dict[str, float]]:
    """Return measures of contact by arm: peak_n (largest force), impulse_n_s, and the largest
    force of the vessel (vessel_n) and of the other instrument (between_n); N and N s.
    """
    measures = {}
    for arm in course.layout.arms:
        force = np.linalg.norm(course[f"{arm}/contact"].astype(float), axis=1)
        measures[arm] = {
            "peak_n": float(force.max()),
            # A row lasts one millisecond, so the sum of forces times 1e-3 s is the impulse.
            "impulse_n_s": float(force.sum() * 1e-3),
            "vessel_n": float(course[f"{arm}/vessel_n"].max()),
            "between_n": float(course[f"{arm}/between_n"].max()),
        }
    return measures


def read_attempts(folder: Path) -> list[Json]:
    """Return measures of a person's earlier sessions of the same scenario, and of this session.
    They are read from the folders beside `folder`. The list is empty if the participant of the
    session in `folder` is not named. A missing number is None.
    """
    sessions = find_sessions(folder.parent)
    present = sessions.get(folder.name)
    if present is None or not present.participant:
        return []
    attempts = []
    for session in sessions.values():
        # A session that was cut short has no measures.
        if (
            session.participant != present.participant
            or session.scenario != present.scenario
            or session.order > present.order
            or KEY not in session.summary
        ):
            continue
        hazards = session.summary.get("hazards") or {}
        arms = session.summary[KEY].get("arms", {}).values()
        arc_lengths = [arm["sparc"] for arm in arms if arm.get("sparc") is not None]
        attempts.append(
            {
                "name": session.path.name,
                "score of 100": hazards.get("score"),
                "reaction, ms": hazards.get("median_reaction_ms"),
                "path, mm": sum(arm.get("path_mm") or 0.0 for arm in arms) if arms else None,
                "smoothness (SPARC)": statistics.fmean(arc_lengths) if arc_lengths else None,
            }
        )
    return attempts


def _movements(course: Recording, tip: np.ndarray, stretches: Sequence[tuple[int, int]]) -> Json:
    # Measures each movement of a tip: within one of `stretches` (ranges of rows with driving), and
    # between two changes of target. Returns the economy over all, the number, and the medians.
    target = course["target"]
    paths_to_targets, arc_lengths, jerks = [], [], []
    for first, last in stretches:
        target_changes = first + 1 + np.flatnonzero(np.diff(target[first:last]))
        for a, b in itertools.pairwise([first, *target_changes.tolist(), last]):
            if (b - a) * 1e-3 < MIN_MOVEMENT_S:
                continue
            path = motion.resample_path(course.ms[a:b], tip[a:b])
            profile = motion.tip_speed(path)
            if profile.max() <= IDLE_MM_S * 1e-3:
                continue
            arc_lengths.append(motion.spectral_arc_length(profile))
            jerks.append(motion.log_dimensionless_jerk(profile))
            # A straight line is the best path only to a target. -1: there is no target.
            if target[a] >= 0:
                paths_to_targets.append(path)
    measures: Json = {"economy": motion.path_economy(paths_to_targets), "movements": len(jerks)}
    for name, values in (("sparc", arc_lengths), ("log_jerk", jerks)):
        known = [x for x in values if x is not None]
        measures[name] = statistics.median(known) if known else None
    return measures
