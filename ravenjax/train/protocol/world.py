"""The operating scene in plain numbers, for what runs every millisecond: arms' frames, axes of
consoles, the tissue.

The same as `geometry.scene` and `geometry.mapping` of the Raven-II, without JAX's scalars.
"""

from __future__ import annotations

from functools import cache

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.geometry import scene
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.train.protocol.messages import VIEW

Point = tuple[float, float, float]
Rows = tuple[Point, Point, Point]


@cache
def frame0(arm: ArmName) -> tuple[Point, Rows]:
    """Origin (m) and rotation rows of the arm's frame 0 in the world."""
    origin, rotation = scene.frame0(arm)
    return _point(origin), (_point(rotation[0]), _point(rotation[1]), _point(rotation[2]))


def to_world(arm: ArmName, position: Point) -> Point:
    """A point of the arm's frame 0 in the world, m."""
    (ox, oy, oz), rows = frame0(arm)
    x, y, z = turned(rows, position)
    return ox + x, oy + y, oz + z


@cache
def itp_from_view(arm: ArmName) -> Rows:
    """Rotation rows from the axes of the operator's view to those of the arm's ITP packets."""
    rows = [frame0(arm)[1], tuple(_point(row) for row in ITP_AXES[arm])]
    columns = []
    for axis in VIEW:
        for turn in rows:
            axis = turned(transposed(turn), axis)  # type: ignore[arg-type]
        columns.append(axis)
    return transposed((columns[0], columns[1], columns[2]))


def view_from_world(way: Point) -> Point:
    """A way in the world along the axes of the operator's view."""
    return turned(VIEW, way)


def surface(x: float, y: float) -> float:
    """Height of the tissue's dome at (x, y) of the world, m; the dome goes on beside the tissue."""
    return scene.TISSUE_TOP - scene.TISSUE_SAG[0] * x * x - scene.TISSUE_SAG[1] * y * y


def turned(rows: Rows, v: Point) -> Point:
    """`rows` times `v`."""
    x, y, z = v
    a, b, c = rows
    return (
        a[0] * x + a[1] * y + a[2] * z,
        b[0] * x + b[1] * y + b[2] * z,
        c[0] * x + c[1] * y + c[2] * z,
    )


def transposed(rows: Rows) -> Rows:
    """The inverse of a rotation."""
    a, b, c = rows
    return (a[0], b[0], c[0]), (a[1], b[1], c[1]), (a[2], b[2], c[2])


def _point(v: object) -> Point:
    x, y, z = (float(number) for number in v)  # type: ignore[union-attr]
    return x, y, z
