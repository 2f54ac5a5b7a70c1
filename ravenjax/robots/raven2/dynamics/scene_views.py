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
# Vertical field of view. Rigid endoscopes see 60 to 75 degrees across their round picture.
_ENDOSCOPE_FOV = np.radians(44.0)
_CAMERAS = _TABLES["cameras"]
"""Camera -> point about which it rotates, m, and factor of its distance in the model.

The distance is larger than in the model, because a window is narrower than the model's picture.
"""
VIEWS = (*ENDOSCOPES, *_CAMERAS)


def view_pose(name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Return the position and the focus of a view, m, and its vertical field of view, rad."""
    if name in ENDOSCOPES:
        position, focus = FIELD + ENDOSCOPES[name], FIELD.copy()
        # The axes of both eyes are parallel.
        if name.endswith(("_left", "_right")):
            focus[0] = position[0]
        return position, focus, float(_ENDOSCOPE_FOV)
    camera, (focus, factor) = arm_model.operating_scene().camera(name), _CAMERAS[name]
    position = focus + factor * (camera.pos - focus)
    return position, np.array(focus), float(np.radians(camera.fovy[0]))
