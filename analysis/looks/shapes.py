"""Defines the visual shapes of each body of the arm, in the link frames of the gold arm.

Sizes follow the extents measured on raven2_sim's left arm meshes (raven_visualization) and a public
photograph. The shapes themselves are new. Green gets every shape mirrored by the signs of its link
frame.
"""

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mesh import Mesh, smooth

X = np.array([1.0, 0.0, 0.0])
SHOULDER_AT = -0.225  # m along z0: shoulder pulley
THICK = ((-0.078, -0.345), (0.0, -0.365), (0.078, -0.345))  # m, (y0, z0) of the RE40 motors
THIN = (
    (-0.092, -0.425),
    (-0.033, -0.445),
    (0.033, -0.445),
    (0.092, -0.425),
)  # m, (y0, z0) of the RE30 motors
RAIL = 0.075  # m from the instrument axis to the rail's middle
SIN_52, COS_52 = np.sin(np.radians(52)), np.cos(np.radians(52))
RAIL_WAY = np.array([0, -SIN_52, -COS_52])  # z3 in frame 2
RAIL_SIDE = np.array([0, COS_52, -SIN_52])  # -x3 in frame 2


# --- meshes ---------------------------------------------------------------------------------------
# --------------------


def _arc(radius: float, x: float, start: float, stop: float, count: int, sign: int) -> np.ndarray:
    """Return points around the x axis from -z (0 deg) towards +y (sign 1) or -y (sign -1)."""
    turns = np.radians(np.linspace(start, stop, count))
    return np.column_stack(
        [np.full(count, x), sign * radius * np.sin(turns), -radius * np.cos(turns)]
    )


def _arc_truss(
    mesh: Mesh,
    inner: float,
    outer: float,
    half: float,
    start: float,
    stop: float,
    bays: int,
    sign: int,
):
    """Add two curved side frames with zigzag webs, joined by rods."""
    for x in (-half, half):
        rims = [_arc(r, x, start, stop, 2 * bays + 1, sign) for r in (inner, outer)]
        for rim in rims:
            mesh.strip(rim, X, 0.007, 0.011)
        for k in range(0, 2 * bays, 2):
            mesh.beam(rims[0][k], rims[1][k + 1], X, 0.006, 0.008)
            mesh.beam(rims[1][k + 1], rims[0][k + 2], X, 0.006, 0.008)
        for k in (0, 2 * bays):
            mesh.beam(rims[0][k], rims[1][k], X, 0.008, 0.012)
    for r in (inner, outer):
        left, right = (_arc(r, x, start, stop, bays + 1, sign) for x in (-half, half))
        for p, q in zip(left, right, strict=True):
            mesh.beam(p, q, np.array([0, p[1], p[2]]), 0.007, 0.007)


def link1() -> Mesh:
    mesh = Mesh()
    _arc_truss(mesh, 0.170, 0.226, 0.034, -7, 82, 6, 1)
    _strip_cover(mesh, 0.2325, 0.034, 14, 62)
    return mesh


def _strip_cover(mesh: Mesh, radius: float, half: float, start: float, stop: float) -> None:
    mesh.strip(_arc(radius, 0.0, start, stop, 13, 1), X, 2 * half, 0.0025)


def link2() -> Mesh:
    mesh = Mesh()
    _arc_truss(mesh, 0.176, 0.222, 0.026, -9, 31, 4, -1)
    low, high, half = 0.165, 0.665, 0.016
    corners = [(i * half, RAIL + j * half) for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))]

    def at(corner, along: float) -> np.ndarray:
        return corner[0] * X + corner[1] * RAIL_SIDE + along * RAIL_WAY

    for corner in corners:
        mesh.beam(at(corner, low), at(corner, high), X, 0.006, 0.006)
    stations = np.linspace(low + 0.01, high - 0.003, 17)
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        side = at(a, 0) - at(b, 0)
        across = np.cross(side, RAIL_WAY)
        for k, s in enumerate(stations):
            mesh.beam(at(a, s), at(b, s), across, 0.004, 0.004)
            if k:
                first, second = (a, b) if k % 2 else (b, a)
                mesh.beam(at(first, stations[k - 1]), at(second, s), across, 0.004, 0.004)
    for x in (-0.0205, 0.0205):  # gussets from the arc into the rail
        for radius, along in ((0.176, 0.20), (0.222, 0.255)):
            mesh.beam(
                _arc(radius, x * 1.2, 27, 27, 1, -1)[0],
                at((x * 0.78, RAIL), along),
                X,
                0.006,
                0.012,
            )
    cap = [
        at((i * 0.019, RAIL + j * 0.019), s)
        for s in (high, high + 0.008)
        for i in (-1, 1)
        for j in (-1, 1)
    ]
    mesh.hexahedron(np.array(cap))
    return mesh


def jaw(side: int) -> Mesh:
    """Return a slim jaw along x with its gripping face at y = 0. Side +1 opens towards +y."""
    mesh = Mesh()
    sections = [
        (-0.0022, 0.0020, 0.0017),
        (0.004, 0.0022, 0.0017),
        (0.013, 0.0015, 0.0014),
        (0.0200, 0.0007, 0.0008),
    ]
    gap = 0.00015
    for (x0, y0, z0), (x1, y1, z1) in itertools.pairwise(sections):
        corners = []
        for x, y, z in ((x0, y0, z0), (x1, y1, z1)):
            corners += [
                (x, s * side, t * z)
                for s in sorted((gap, y), key=lambda v: v * side)
                for t in (-1, 1)
            ]
        mesh.hexahedron(np.array(corners))
    for k in range(5):  # teeth
        x = 0.008 + 0.0022 * k
        mesh.beam((x, gap * side, 0), (x + 0.0011, gap * side, 0), (0, 0, 1), 0.0022, 0.0006)
    return mesh


def cables() -> Mesh:
    """Return the white cable loops of the motor pack, in frame 0 (x up, z inward)."""
    mesh = Mesh()
    for (y, z), reach in zip([*THIN, THICK[1]], (0.08, 0.13, 0.10, 0.07, 0.11), strict=True):
        out = -0.58 - 0.3 * reach
        mesh.tube(
            smooth(
                [
                    (0.080, y, z),
                    (0.125 + 0.3 * reach, y * 1.02, z - 0.012),
                    (0.135 + 0.4 * reach, y * 1.1, z - 0.075),
                    (-0.02, y * 1.1 + 0.01, out),
                    (-0.18, y * 0.9, out - 0.01),
                    (-0.258, y * 0.6, out + 0.03),
                ],
                26,
            ),
            0.0042,
            8,
        )
    return mesh


MESHES: dict[str, Callable[[], Mesh]] = {
    "link1": link1,
    "link2": link2,
    "jaw1": lambda: jaw(-1),
    "jaw2": lambda: jaw(1),
    "cables": cables,
}
MESH_OF_BODY = {
    "shoulder": "link1",
    "elbow": "link2",
    "grasp1": "jaw1",
    "grasp2": "jaw2",
    "frame0": "cables",
}
MESH_MATERIAL = {
    "link1": "black",
    "link2": "black",
    "jaw1": "steel",
    "jaw2": "steel",
    "cables": "cable",
}


# --- geoms ----------------------------------------------------------------------------------------
# --------------------


class Pen:
    """Adds geoms to a body, mirrored by the signs of its frame."""

    def __init__(self, body: ET.Element, signs: np.ndarray) -> None:
        self.body, self.signs = body, signs

    def _geom(self, kind: str, material: str, **attributes: str) -> None:
        ET.SubElement(
            self.body, "geom", {"type": kind, "material": material, "class": "visual", **attributes}
        )

    def rod(self, start, end, radius: float, material: str, kind: str = "cylinder") -> None:
        ends = [*(self.signs * start), *(self.signs * end)]
        self._geom(kind, material, fromto=_text(ends), size=_text([radius]))

    def block(self, center, size, material: str) -> None:
        """Add a block with full edge lengths, along the axes of the body's frame."""
        self._geom("box", material, pos=_text(self.signs * center), size=_text(np.array(size) / 2))

    def mesh(self, name: str, material: str) -> None:
        mirrored = tuple(self.signs) != (1, 1, 1)
        self._geom("mesh", material, mesh=f"{name}_mirrored" if mirrored else name)


def _text(values) -> str:
    return " ".join(f"{float(x) + 0.0:.6g}" for x in values)


def _base(pen: Pen) -> None:
    pen.block((-0.062, 0.0, -0.405), (0.012, 0.25, 0.25), "black")
    pen.block((-0.030, 0.0, -0.287), (0.064, 0.110, 0.012), "black")
    pen.block((0.012, 0.0, -0.287), (0.10, 0.085, 0.012), "black")
    pen.rod((0, 0, -0.315), (0, 0, SHOULDER_AT + 0.004), 0.024, "steel")
    pen.rod((0, 0, -0.300), (0, 0, -0.262), 0.043, "black")
    for radius, top, places in ((0.021, 0.108, THICK), (0.0165, 0.088, THIN)):
        for y, z in places:
            pen.rod((-0.056, y, z), (-0.020, y, z), radius * 1.12, "black")  # gearbox flange
            pen.rod((-0.020, y, z), (0.020, y, z), radius * 0.96, "steel")
            pen.rod((0.020, y, z), (top - 0.024, y, z), radius, "silver")
            pen.rod((top - 0.024, y, z), (top, y, z), radius * 0.97, "black")  # encoder
            pen.rod((-0.086, y, z), (-0.068, y, z), radius * 0.42, "steel")  # capstan
    pen.block((-0.058, 0.0, -0.515), (0.085, 0.19, 0.02), "silver")


def _link1(pen: Pen) -> None:
    pen.rod((0, 0, SHOULDER_AT - 0.008), (0, 0, SHOULDER_AT + 0.008), 0.0625, "pulley")
    pen.rod((0, 0, SHOULDER_AT - 0.011), (0, 0, SHOULDER_AT - 0.008), 0.066, "black")
    pen.rod((0, 0, SHOULDER_AT + 0.008), (0, 0, SHOULDER_AT + 0.011), 0.066, "black")
    pen.rod((0, 0, -0.262), (0, 0, -0.165), 0.017, "steel")
    out = np.array([0, np.sin(np.radians(75)), -np.cos(np.radians(75))])
    pen.rod(out * 0.160, out * 0.240, 0.026, "black")
    pen.rod(out * 0.150, out * 0.248, 0.010, "steel")
    for turn, radius, x in (
        (20, 0.0155, 0.044),
        (44, 0.0155, 0.044),
        (44, 0.011, -0.044),
        (64, 0.013, -0.044),
    ):
        center = _arc(0.198, 0.0, turn, turn, 1, 1)[0]
        pen.rod(center + X * (x - np.sign(x) * 0.012), center + X * x, radius, "pulley")
        pen.rod(
            center + X * (x - np.sign(x) * 0.012),
            center + X * (x + np.sign(x) * 0.003),
            radius * 0.35,
            "steel",
        )


def _link2(pen: Pen) -> None:
    down = np.array([0, 0, -1.0])
    pen.rod(down * 0.192, down * 0.208, 0.041, "pulley")
    pen.rod(down * 0.208, down * 0.211, 0.044, "black")
    pen.rod(down * 0.189, down * 0.192, 0.044, "black")
    pen.rod(down * 0.225, down * 0.250, 0.022, "black")
    for turn, radius, x in (
        (14, 0.014, 0.034),
        (26, 0.011, 0.034),
        (14, 0.011, -0.034),
        (26, 0.014, -0.034),
    ):
        center = _arc(0.199, 0.0, turn, turn, 1, -1)[0]
        pen.rod(center + X * (x - np.sign(x) * 0.010), center + X * x, radius, "pulley")
        pen.rod(
            center + X * (x - np.sign(x) * 0.010),
            center + X * (x + np.sign(x) * 0.003),
            radius * 0.35,
            "steel",
        )
    for along, radius in (
        (0.655, 0.0125),
        (0.185, 0.0125),
    ):  # cable return pulleys at both ends of the rail
        for x in (-0.026, 0.026):
            center = RAIL_WAY * along + RAIL_SIDE * (RAIL - 0.004)
            pen.rod(center + X * (x - np.sign(x) * 0.006), center + X * x, radius, "pulley")
    for x in (-0.023, 0.023):  # drive cables along the rail
        for offset in (-0.012, 0.008):
            near = RAIL_SIDE * (RAIL + offset) + X * x
            pen.rod(RAIL_WAY * 0.185 + near, RAIL_WAY * 0.655 + near, 0.0006, "steel")
    pen.rod(
        RAIL_WAY * 0.19 + RAIL_SIDE * 0.053, RAIL_WAY * 0.655 + RAIL_SIDE * 0.053, 0.0038, "steel"
    )  # guide rod


def _carriage(pen: Pen) -> None:
    pen.block((-0.040, 0.0, 0.004), (0.026, 0.074, 0.104), "black")
    for y in (-0.031, 0.031):
        pen.block((-0.072, y, 0.004), (0.044, 0.010, 0.074), "black")
    pen.block((-0.006, 0.0, -0.006), (0.046, 0.062, 0.066), "black")
    pen.block((-0.004, 0.0, 0.034), (0.062, 0.078, 0.010), "silver")
    pen.block((-0.002, 0.0, -0.044), (0.050, 0.066, 0.008), "silver")
    for y in (-0.021, 0.021):
        for x in (-0.016, 0.014):
            pen.rod((x, y, 0.039), (x, y, 0.056), 0.0109, "pulley")  # tool spindles
            pen.rod((x, y, 0.056), (x, y, 0.060), 0.0050, "steel")
    for y in (-0.042, 0.042):
        for z in (-0.030, 0.028):
            pen.rod(
                (-0.040, y - np.sign(y) * 0.004, z),
                (-0.040, y + np.sign(y) * 0.006, z),
                0.0125,
                "pulley",
            )
    pen.rod((0, 0, -0.066), (0, 0, -0.046), 0.0105, "black")


def _shaft(pen: Pen) -> None:
    pen.rod((0, 0, 0.002), (0, 0, 0.410), 0.00425, "steel")
    pen.rod((0, 0, 0.385), (0, 0, 0.412), 0.0068, "black")
    pen.rod((0, 0, 0.000), (0, 0, 0.010), 0.0046, "gunmetal")


def _wrist(pen: Pen) -> None:
    pen.rod((0, 0, -0.0042), (0, 0, 0.0042), 0.0030, "steel")
    pen.block((0.0035, 0, 0), (0.010, 0.0046, 0.0050), "gunmetal")
    for y in (-0.0028, 0.0028):
        pen.block((0.0100, y, 0), (0.0095, 0.0014, 0.0050), "gunmetal")
    pen.rod((0.013, -0.0037, 0), (0.013, 0.0037, 0), 0.0026, "steel")


GEOMS: dict[str, Callable[[Pen], None]] = {
    "frame0": _base,
    "shoulder": _link1,
    "elbow": _link2,
    "insertion": _carriage,
    "tool_roll": _shaft,
    "wrist": _wrist,
}


def add(body: ET.Element, name: str, signs: np.ndarray) -> None:
    """Add the shapes of body `name`, mirrored by `signs`."""
    pen = Pen(body, signs)
    if name in GEOMS:
        GEOMS[name](pen)
    if name in MESH_OF_BODY:
        mesh = MESH_OF_BODY[name]
        pen.mesh(mesh, MESH_MATERIAL[mesh])


def add_assets(assets: ET.Element, flipped: dict[str, tuple[int, int, int]]) -> None:
    """Declare the meshes, and the mirrored ones by the signs of the body that shows them."""
    for body, name in MESH_OF_BODY.items():
        ET.SubElement(assets, "mesh", {"name": name, "class": "visual", "file": f"{name}.obj"})
        if flipped[body] != (1, 1, 1):
            scale = " ".join(str(sign) for sign in flipped[body])
            ET.SubElement(
                assets,
                "mesh",
                {
                    "name": f"{name}_mirrored",
                    "class": "visual",
                    "file": f"{name}.obj",
                    "scale": scale,
                },
            )


def write_meshes(folder: Path) -> None:
    for name, make in MESHES.items():
        make().write(folder / f"{name}.obj")
