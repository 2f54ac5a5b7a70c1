"""Views of the scene: the endoscopes, and the cameras of the MuJoCo model."""

import numpy as np

from ravenjax import resources
from ravenjax.robots.raven2.dynamics import arm_model

_TABLES = resources.read_tables(__file__, "scene_views.toml")
ENDOSCOPES = _TABLES["endoscopes"]
"""Endoscope -> position relative to `FIELD_CENTRE`, m, world. Stereo eyes are 5 to 6 mm apart."""
FIELD_CENTRE = np.array([0.0, 0.0, 0.192])
"""Middle of the operating field, a little above the tissue, m, world frame."""
# Vertical field of view. Rigid endoscopes see 60 to 75 degrees across their round picture.
_ENDOSCOPE_FOV = np.radians(44.0)
_CAMERAS = _TABLES["cameras"]
"""Camera -> point about which it rotates, m, and factor by which its distance from this point is
larger than in the model. A window is narrower than the model's picture, so cameras are farther off.
"""
VIEWS = (*ENDOSCOPES, *_CAMERAS)


def view_pose(name: str) -> tuple[np.ndarray, np.ndarray, float]:
    """Return position and focus of a view, m, world frame, and its vertical field of view, rad."""
    if name in ENDOSCOPES:
        position, focus = FIELD_CENTRE + ENDOSCOPES[name], FIELD_CENTRE.copy()
        # The two eyes look along parallel axes
        if name.endswith(("_left", "_right")):
            focus[0] = position[0]
        return position, focus, float(_ENDOSCOPE_FOV)
    camera, (focus, factor) = arm_model.operating_scene().camera(name), _CAMERAS[name]
    # `factor` times as far from the focus as in the model, whose picture is wider than a window
    position = focus + factor * (camera.pos - focus)
    return position, np.array(focus), float(np.radians(camera.fovy[0]))
