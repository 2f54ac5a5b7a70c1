"""Builds triangle meshes from beams, swept strips, tubes and grids, and writes them as OBJ text.
Lengths are in metres.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

BOX_FACES = ((0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5))


class Mesh:
    """Vertices and triangles; parts are added one by one."""

    def __init__(self) -> None:
        self.vertices: list[np.ndarray] = []
        self.triangles: list[tuple[int, int, int]] = []

    def quads(self, vertices: np.ndarray, faces) -> Mesh:
        first = len(self.vertices)
        self.vertices.extend(np.asarray(vertices, dtype=float))
        for a, b, c, d in faces:
            self.triangles += [(first + a, first + b, first + c), (first + a, first + c, first + d)]
        return self

    def hexahedron(self, corners: np.ndarray) -> Mesh:
        """Add a hexahedron from eight corners, index = 4 i + 2 j + k along three right-handed edge
        directions.
        """
        return self.quads(corners, BOX_FACES)

    def beam(self, start, end, side, width: float, height: float) -> Mesh:
        """Add a bar from start to end. `width` is measured along `side`, `height` across it."""
        start, end, side = (np.asarray(v, dtype=float) for v in (start, end, side))
        along = (end - start) / np.linalg.norm(end - start)
        side = side - along * (along @ side)
        side /= np.linalg.norm(side)
        up = np.cross(along, side)
        corners = [
            p + i * side * width / 2 + j * up * height / 2
            for p in (start, end)
            for i in (-1, 1)
            for j in (-1, 1)
        ]
        return self.hexahedron(np.array(corners))

    def strip(self, path: np.ndarray, side, width: float, height: float) -> Mesh:
        """Add a rectangular bar along a polyline in the plane across `side`, mitred at its
        corners.
        """
        path, side = np.asarray(path, dtype=float), np.asarray(side, dtype=float)
        tangents = np.gradient(path, axis=0)
        tangents /= np.linalg.norm(tangents, axis=1)[:, None]
        ups = np.cross(tangents, side)
        rings = [
            p + i * side * width / 2 + j * up * height / 2
            for p, up in zip(path, ups, strict=True)
            for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
        ]
        return self._loft(np.array(rings), 4)

    def tube(self, path: np.ndarray, radius, sides: int = 10) -> Mesh:
        """Add a round bar along a polyline, with one radius or one per point."""
        path = np.asarray(path, dtype=float)
        radii = np.broadcast_to(radius, len(path))
        tangents = np.gradient(path, axis=0)
        tangents /= np.linalg.norm(tangents, axis=1)[:, None]
        normal = np.cross(tangents[0], np.eye(3)[np.argmin(np.abs(tangents[0]))])
        rings = []
        for p, t, r in zip(path, tangents, radii, strict=True):
            normal = normal - t * (t @ normal)
            normal /= np.linalg.norm(normal)
            other = np.cross(t, normal)
            turns = 2 * np.pi * np.arange(sides) / sides
            rings += [p + r * (np.cos(a) * normal + np.sin(a) * other) for a in turns]
        return self._loft(np.array(rings), sides)

    def slab(self, top: np.ndarray, bottom: float) -> Mesh:
        """Add a solid under a grid of points (rows x columns x 3) down to the height `bottom`."""
        rows, columns = top.shape[:2]
        low = top.copy()
        low[..., 2] = bottom
        base = rows * columns

        def at(i: int, j: int, level: int) -> int:
            return level * base + i * columns + j

        faces = []
        for i in range(rows - 1):
            for j in range(columns - 1):
                faces.append((at(i, j, 0), at(i + 1, j, 0), at(i + 1, j + 1, 0), at(i, j + 1, 0)))
                faces.append((at(i, j, 1), at(i, j + 1, 1), at(i + 1, j + 1, 1), at(i + 1, j, 1)))
        for i in range(rows - 1):
            faces.append((at(i, 0, 0), at(i, 0, 1), at(i + 1, 0, 1), at(i + 1, 0, 0)))
            faces.append(
                (
                    at(i, columns - 1, 0),
                    at(i + 1, columns - 1, 0),
                    at(i + 1, columns - 1, 1),
                    at(i, columns - 1, 1),
                )
            )
        for j in range(columns - 1):
            faces.append((at(0, j, 0), at(0, j + 1, 0), at(0, j + 1, 1), at(0, j, 1)))
            faces.append(
                (
                    at(rows - 1, j, 0),
                    at(rows - 1, j, 1),
                    at(rows - 1, j + 1, 1),
                    at(rows - 1, j + 1, 0),
                )
            )
        return self.quads(np.concatenate([top.reshape(-1, 3), low.reshape(-1, 3)]), faces)

    def _loft(self, rings: np.ndarray, sides: int) -> Mesh:
        count = len(rings) // sides
        faces = [
            (
                sides * k + i,
                sides * k + (i + 1) % sides,
                sides * (k + 1) + (i + 1) % sides,
                sides * (k + 1) + i,
            )
            for k in range(count - 1)
            for i in range(sides)
        ]
        first = len(self.vertices)
        self.quads(rings, faces)
        last = first + sides * (count - 1)
        for i in range(1, sides - 1):
            self.triangles += [(first, first + i + 1, first + i), (last, last + i, last + i + 1)]
        return self

    def write(self, path: Path) -> None:
        lines = ["v {:.5f} {:.5f} {:.5f}".format(*(v + 0.0)) for v in self.vertices]
        lines += [f"f {a + 1} {b + 1} {c + 1}" for a, b, c in self.triangles]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("\n".join(lines) + "\n", encoding="ascii")


def smooth(points, count: int) -> np.ndarray:
    """Return `count` points on a Catmull-Rom curve through `points`."""
    points = np.asarray(points, dtype=float)
    padded = np.vstack([2 * points[0] - points[1], points, 2 * points[-1] - points[-2]])
    out = []
    for u in np.linspace(0, len(points) - 1, count):
        k = min(int(u), len(points) - 2)
        t = u - k
        a, b, c, d = padded[k : k + 4]
        out.append(
            0.5
            * (
                2 * b
                + (c - a) * t
                + (2 * a - 5 * b + 4 * c - d) * t**2
                + (3 * b - a - 3 * c + d) * t**3
            )
        )
    return np.array(out)
