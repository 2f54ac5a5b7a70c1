"""Computes where the jaws close, which a person takes for the tip of an instrument.

The software's tip is the axis of the jaws. These functions use plain numbers, because they run
every millisecond. The direction is that of `geometry.arrays.jaw_rotation`.
"""

import math
from collections.abc import Sequence

import numpy as np

from ravenjax.train.protocol.frame import Frame, FrameLayout
from ravenjax.train.protocol.world import Point
from ravenjax.train.robot import GEOMETRY, GM1, GM2, GM3, JAW_LENGTH, ArmName

_DRAWN = {"tip": "link_jpos", "virtual_tip": "virtual_jpos", "model_tip": "model_jpos"}
"""Channels of the jaws' axis, each with the channel of its joints."""


def closing_point(arm: ArmName, axis: Sequence[float], jpos: Sequence[float]) -> Point:
    """Return where the ends of the jaws meet, m. axis: their axis, m, frame 0. jpos: [7]."""
    x, y, z = jaw_direction(arm, jpos)
    return axis[0] + JAW_LENGTH * x, axis[1] + JAW_LENGTH * y, axis[2] + JAW_LENGTH * z


def jaw_tips(arm: ArmName, closing: Sequence[float], jpos: Sequence[float]) -> tuple[Point, Point]:
    """Return the ends of both jaws, m, frame 0. closing: where they close. jpos: joints [7]."""
    middle = jaw_direction(arm, jpos)
    out = []
    for angle in (-jpos[5], jpos[6]):
        way = jaw_direction(arm, (*jpos[:5], -angle, angle))
        out.append(
            tuple(c + JAW_LENGTH * (a - b) for c, a, b in zip(closing, way, middle, strict=True))
        )
    return out[0], out[1]


def jaw_direction(arm: ArmName, jpos: Sequence[float]) -> Point:
    """Return the unit vector along the closed jaws in frame 0, at joints [7] in rad and m."""
    geometry = GEOMETRY[arm]
    cos23, side, flip = geometry.cos23, geometry.side, geometry.flip
    theta1, theta2 = jpos[0] + geometry.zero1, jpos[1] + geometry.zero2
    s2, c2 = math.sin(theta2), math.cos(theta2)
    roll, bend, yaw = jpos[3], jpos[4], 0.5 * (jpos[6] - jpos[5])
    # Axes of frame 3 in frame 1, then those of frames 4 to 6. theta5 is the wrist minus a quarter
    # turn.
    x3 = (
        -side * cos23 * s2,
        side * (GM2 * cos23 * c2 - GM1 * GM3),
        side * (GM1 * cos23 * c2 + GM2 * GM3),
    )
    y3 = (-side * c2, -side * GM2 * s2, -side * GM1 * s2)
    z3 = (GM3 * s2, -GM2 * GM3 * c2 - GM1 * cos23, -GM1 * GM3 * c2 + GM2 * cos23)
    s4, c4 = math.sin(roll), math.cos(roll)
    s5, c5 = -math.cos(bend), math.sin(bend)
    s6, c6 = math.sin(yaw), math.cos(yaw)
    by_x, by_y = c4 * c5 * c6 + s4 * s6, s4 * c5 * c6 - c4 * s6
    x, y, z = (by_x * a + by_y * b + s5 * c6 * c for a, b, c in zip(x3, y3, z3, strict=True))
    s1, c1 = math.sin(theta1), math.cos(theta1)
    return c1 * x - s1 * y, flip * (s1 * x + c1 * y), flip * z


def with_tips(layout: FrameLayout, row: np.ndarray) -> np.ndarray:
    """Return a copy of a frame's row, with tips where the jaws close, for drawing."""
    frame = Frame(layout, row.copy())
    for arm in layout.arms:
        for axis, joints in _DRAWN.items():
            place = f"{arm}/{axis}"
            frame[place] = closing_point(
                arm, frame[place].tolist(), frame[f"{arm}/{joints}"].tolist()
            )
    return frame.row
