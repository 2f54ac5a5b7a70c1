"""Prepares the three-dimensional replay of a session: data for `templates/replay.js`, thinned.

Positions are in the world, in tenths of a millimetre as whole numbers, so that a page can hold half
an hour of them.
"""

from collections.abc import Sequence

import numpy as np

from ravenjax.train.judge.episode import HazardRow
from ravenjax.train.protocol.messages import Json
from ravenjax.train.protocol.world import TISSUE
from ravenjax.train.recording.reader import Recording
from ravenjax.train.robot import JAW_LENGTH, jaw_rotation

EVERY_MS, EVERY_HAZARD_MS = 40, 10
"""Time between two pictures. The second value applies around a hazard, where motion is fast."""
MOST = 20_000
"""The largest number of pictures of a session. Longer sessions get fewer per second."""
AROUND_MS = (400, 3000)
PER_M = 10_000


def player_data(course: Recording, header: Json, hazards: Sequence[HazardRow]) -> Json | None:
    """Return JSON for the player; None if the header lacks the positions of the arms."""
    bases, arms = header.get("bases") or {}, course.layout.arms
    if any(arm not in bases for arm in arms):
        return None
    first, last = course.ms[0], course.ms[-1]
    times = [np.arange(first, last, max(EVERY_MS, int(last - first) // MOST)), [last]]
    marks = []
    for row in hazards:
        if row.struck_ms is not None:
            begin, end = row.struck_ms - AROUND_MS[0], row.struck_ms + AROUND_MS[1]
            times.append(np.arange(begin, end, EVERY_HAZARD_MS))
            text = row.title or row.hazard
            marks.append({"ms": row.struck_ms - first, "kind": "strike", "text": text})
            if row.response_ms is not None:
                after_ms = row.response_ms - first
                marks.append({"ms": after_ms, "kind": "response", "text": row.response})
    rows = np.unique(np.searchsorted(course.ms, np.concatenate(times)))
    rows = rows[rows < len(course.ms)]
    return {
        "ms": (course.ms[rows] - first).astype(int).tolist(),
        "pedal": course["pedal"][rows].astype(int).tolist(),
        "target": course["target"][rows].astype(int).tolist(),
        "arms": {
            arm: _arm(course, arm, bases[arm], rows, bool(header.get("blinded"))) for arm in arms
        },
        "task": header.get("task") or {},
        "tissue": TISSUE,
        "marks": marks,
    }


def _arm(course: Recording, arm: str, base: Json, rows: np.ndarray, blinded: bool) -> Json:
    # The import takes half a second.
    from scipy.spatial.transform import Rotation

    origin = np.asarray(base["origin"], float)
    turn = Rotation.from_quat(base["quaternion"]).as_matrix()
    drawing = {"remote": np.rint(PER_M * origin).astype(int).tolist()}
    for name, axis, joints in (
        ("tip", "tip", "link_jpos"),
        ("model", "model_tip", "model_jpos"),
    )[: 1 if blinded else 2]:
        jaws = JAW_LENGTH * jaw_rotation(arm, course[f"{arm}/{joints}"][rows])[..., 0]
        points = origin + np.nan_to_num(course[f"{arm}/{axis}"][rows] + jaws) @ turn.T
        drawing[name] = np.rint(PER_M * points).astype(int).tolist()
    return drawing
