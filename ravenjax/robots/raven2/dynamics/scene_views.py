"""Views of the scene: the endoscopes, and the cameras of the MuJoCo model."""

import numpy as np

from ravenjax.bundled import resources
from ravenjax.robots.raven2.dynamics import arm_model

_TABLES = resources.read_tables(__file__, "scene_views.toml")
ENDOSCOPES = _TABLES["endoscopes"]
"""Positions of the endoscopes from the middle of the field, m.

The eyes of a stereo endoscope are 5 to 6 mm apart.
"""
FIELD = np.array([0.0, 0.0, 0.192])
"""Middle of the field, a little above the tissue, m."""
# Upward. Rigid endoscopes see 60 to 75 degrees across their round picture.
_ENDOSCOPE_FOV = np.radians(44.0)
_CAMERAS = _TABLES["cameras"]
"""For each camera, the point about which it turns, m, and its distance by that in the model.

The distance is larger because a window is narrower than the model's picture.
"""
VIEWS = (*ENDOSCOPES, *_CAMERAS)


def view_pose(name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Return position and the point looked at, m, and the field of view upward, rad."""
    if name in ENDOSCOPES:
        place, focus = FIELD + ENDOSCOPES[name], FIELD.copy()
        # The axes of both eyes are parallel.
        if name.endswith(("_left", "_right")):
            focus[0] = place[0]
        return place, focus, float(_ENDOSCOPE_FOV)
    camera, (focus, share) = arm_model.operating_scene().camera(name), _CAMERAS[name]
    place = focus + share * (camera.pos - focus)
    return place, np.array(focus), float(np.radians(camera.fovy[0]))
