"""The session to be looked at again in three dimensions: what `templates/replay.js` draws, thinned
to what it needs.

Places are those of the world, in tenths of a millimetre as whole numbers: a page holds half an hour
of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ravenjax.robots.raven2.geometry import scene
from ravenjax.robots.raven2.geometry.instrument import JAW_LENGTH
from ravenjax.robots.raven2.geometry.links import jaw_rotation
from ravenjax.train.debrief import words
from ravenjax.train.debrief.course import Course
from ravenjax.train.judge.row import HazardRow

EVERY_MS, EVERY_HAZARD_MS = 40, 10
"""Between two pictures; the second around a hazard, where things go fast."""
MOST = 20_000
"""Pictures of a session, the longest of which get fewer a second."""
AROUND_MS = (400, 3000)
PER_M = 10_000


def of(
    course: Course, header: dict[str, Any], hazards: Sequence[HazardRow]
) -> dict[str, Any] | None:
    """JSON for the player; None where the session's header does not say where its arms stand."""
    bases = header.get("bases") or {}
    if len(course.ms) < 2 or any(arm not in bases for arm in course.layout.arms):
        return None
    rows = _pictures(course, hazards)
    return {
        "ms": course.ms[rows].astype(int).tolist(),
        "pedal": course.channel("pedal")[rows].astype(int).tolist(),
        "target": course.channel("target")[rows].astype(int).tolist(),
        "arms": {arm: _arm(course, arm, bases[arm], rows) for arm in course.layout.arms},
        "task": _task(header.get("task") or {}),
        "tissue": {"top": scene.TISSUE_TOP, "sag": scene.TISSUE_SAG, "half": scene.TISSUE_HALF},
        "marks": [mark for one in hazards for mark in _marks(one)],
    }


def _pictures(course: Course, hazards: Sequence[HazardRow]) -> np.ndarray:
    """Numbers of the rows that are shown."""
    every = max(EVERY_MS, int(course.ms[-1] - course.ms[0]) // MOST)
    times = np.arange(course.ms[0], course.ms[-1], every)
    for one in hazards:
        if one.struck_ms is not None:
            first, last = one.struck_ms - AROUND_MS[0], one.struck_ms + AROUND_MS[1]
            times = np.concatenate([times, np.arange(first, last, EVERY_HAZARD_MS)])
    rows = np.unique(np.searchsorted(course.ms, np.append(times, course.ms[-1])))
    return rows[rows < len(course.ms)]


def _arm(course: Course, arm: str, base: dict[str, Any], rows: np.ndarray) -> dict[str, Any]:
    """Remote centre, where the jaws close and, unless the session is blinded, that of the
    nominal model.
    """
    from scipy.spatial.transform import Rotation  # half a second

    origin, turn = (
        np.asarray(base["origin"], float),
        Rotation.from_quat(base["quaternion"]).as_matrix(),
    )

    def places(axis: str, joints: str) -> list[list[int]]:
        jaws = JAW_LENGTH * jaw_rotation(arm, course.channel(f"{arm}/{joints}")[rows])[..., 0]
        points = origin + np.nan_to_num(course.channel(f"{arm}/{axis}")[rows] + jaws) @ turn.T
        return np.rint(PER_M * points).astype(int).tolist()

    drawing = {
        "remote": np.rint(PER_M * origin).astype(int).tolist(),
        "tip": places("tip", "link_jpos"),
    }
    return drawing if course.blinded else drawing | {"model": places("model_tip", "model_jpos")}


def _task(task: dict[str, Any]) -> dict[str, Any]:
    """What there was to reach, m."""
    path = task.get("path") or {}
    return {
        "targets": [
            {"number": one["number"], "at": one["at"]} for one in task.get("targets") or ()
        ],
        "pegs": [{"number": one["number"], "at": one["top"]} for one in task.get("pegs") or ()],
        "path": path.get("points", []),
    }


def _marks(one: HazardRow) -> list[dict[str, Any]]:
    """When it struck, and when the operator responded; none of a hazard that never struck."""
    if one.struck_ms is None:
        return []
    marks = [{"ms": one.struck_ms, "kind": "strike", "text": words.title(one)}]
    if one.response_ms is not None:
        marks.append({"ms": one.response_ms, "kind": "response", "text": one.response})
    return marks
