"""The operating scene in plain numbers, for code that runs every millisecond.

It has the arms' frames, the axes of consoles, and the tissue, as in `geometry.scene` and
`geometry.mapping`. It also has where the jaws close, which a person takes for the tip of an
instrument. The software's tip is the axis of the jaws.
"""

import math
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from ravenjax.train.protocol.frame import Frame, FrameLayout
from ravenjax.train.protocol.messages import VIEW
from ravenjax.train.robot import GEOMETRY, GM1, GM2, GM3, ITP_AXES, JAW_LENGTH, ArmName, scene

TISSUE = {"top": scene.TISSUE_TOP, "sag": scene.TISSUE_SAG, "half": scene.TISSUE_HALF}
"""The tissue's dome for a window that draws it, m."""
Point = tuple[float, float, float]
Rows = tuple[Point, Point, Point]


@cache
def frame0_in_world(arm: ArmName) -> tuple[Point, Rows]:
    """Return origin (m) and rotation rows of the arm's frame 0 in the world."""
    origin, rotation = scene.frame0_in_world(arm)
    rows = _rows([origin, *rotation])
    return rows[0], rows[1:]


def to_world(arm: ArmName, position: Point) -> Point:
    """Return a point of the arm's frame 0 in the world, m."""
    (ox, oy, oz), rows = frame0_in_world(arm)
    x, y, z = turn_vector(rows, position)
    return ox + x, oy + y, oz + z


@cache
def itp_from_view(arm: ArmName) -> Rows:
    """Return rotation rows from the axes of the operator's view to those of ITP packets."""
    rotation, axes = np.array(frame0_in_world(arm)[1]), np.array(_rows(ITP_AXES[arm]))
    return _rows(axes.T @ rotation.T @ np.array(VIEW).T)


def view_from_world(way: Point) -> Point:
    """Return a displacement in the world along the axes of the operator's view."""
    return turn_vector(VIEW, way)


def tissue_height(x: float, y: float) -> float:
    """Return the height of the tissue's dome at (x, y), m, also beside the tissue."""
    return scene.TISSUE_TOP - scene.TISSUE_SAG[0] * x * x - scene.TISSUE_SAG[1] * y * y


def turn_vector(rows: Rows, v: Point) -> Point:
    """Return `rows` times `v`."""
    x, y, z = v
    a, b, c = rows
    return (
        a[0] * x + a[1] * y + a[2] * z,
        b[0] * x + b[1] * y + b[2] * z,
        c[0] * x + c[1] * y + c[2] * z,
    )


def _rows(matrix: Any) -> Any:
    return tuple(tuple(float(number) for number in row) for row in matrix)


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
