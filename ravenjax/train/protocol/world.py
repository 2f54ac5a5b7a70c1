"""The operating scene in plain numbers, for code that runs every millisecond.

It has the arms' frames, the axes of consoles, and the tissue, as in `geometry.scene` and
`geometry.mapping`.
"""

from functools import cache
from typing import Any

import numpy as np

from ravenjax.train.protocol.messages import VIEW
from ravenjax.train.robot import ITP_AXES, ArmName, scene

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
