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


def data(
    course: Course, header: dict[str, Any], hazards: Sequence[HazardRow]
) -> dict[str, Any] | None:
    """JSON for the player; None where the session's header does not say where its arms stand."""
    bases = header.get("bases") or {}
    if len(course.ms) < 2 or any(arm not in bases for arm in course.layout.arms):
        return None
    struck = [(one, one.struck_ms) for one in hazards if one.struck_ms is not None]
    marks = []
    for one, ms in struck:
        marks.append({"ms": ms, "kind": "strike", "text": words.title(one)})
        if one.response_ms is not None:
            marks.append({"ms": one.response_ms, "kind": "response", "text": one.response})
    rows = _pictures(course, [ms for _, ms in struck])
    task = header.get("task") or {}
    targets, pegs = task.get("targets") or (), task.get("pegs") or ()
    return {
        "ms": course.ms[rows].astype(int).tolist(),
        "pedal": course.channel("pedal")[rows].astype(int).tolist(),
        "target": course.channel("target")[rows].astype(int).tolist(),
        "arms": {arm: _arm(course, arm, bases[arm], rows) for arm in course.layout.arms},
        "task": {
            "targets": [{"number": one["number"], "at": one["at"]} for one in targets],
            "pegs": [{"number": one["number"], "at": one["top"]} for one in pegs],
            "path": (task.get("path") or {}).get("points", []),
        },
        "tissue": {"top": scene.TISSUE_TOP, "sag": scene.TISSUE_SAG, "half": scene.TISSUE_HALF},
        "marks": marks,
    }


def _pictures(course: Course, strikes: Sequence[float]) -> np.ndarray:
    """Numbers of the rows that are shown."""
    first, last = course.ms[0], course.ms[-1]
    times = [np.arange(first, last, max(EVERY_MS, int(last - first) // MOST)), [last]]
    for ms in strikes:
        times.append(np.arange(ms - AROUND_MS[0], ms + AROUND_MS[1], EVERY_HAZARD_MS))
    rows = np.unique(np.searchsorted(course.ms, np.concatenate(times)))
    return rows[rows < len(course.ms)]


def _arm(course: Course, arm: str, base: dict[str, Any], rows: np.ndarray) -> dict[str, Any]:
    """Remote centre, where the jaws close and, unless the session is blinded, that of the
    nominal model.
    """
    # half a second
    from scipy.spatial.transform import Rotation

    origin = np.asarray(base["origin"], float)
    turn = Rotation.from_quat(base["quaternion"]).as_matrix()

    def places(axis: str, joints: str) -> list[list[int]]:
        jaws = JAW_LENGTH * jaw_rotation(arm, course.channel(f"{arm}/{joints}")[rows])[..., 0]
        points = origin + np.nan_to_num(course.channel(f"{arm}/{axis}")[rows] + jaws) @ turn.T
        return np.rint(PER_M * points).astype(int).tolist()

    remote = np.rint(PER_M * origin).astype(int).tolist()
    drawing = {"remote": remote, "tip": places("tip", "link_jpos")}
    return drawing if course.blinded else drawing | {"model": places("model_tip", "model_jpos")}
