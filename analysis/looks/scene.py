"""Builds the operating scene around the arms: board, frames, phantom, vessel, light. World axes: x
right, y away, z up; metres.
"""

import xml.etree.ElementTree as ET
from collections.abc import Callable
from pathlib import Path

import numpy as np
from mesh import Mesh, smooth

# Of the green arm; gold has -x. Puts the tips 3 cm apart over the phantom at home.
RCM = (0.028, -0.025, 0.28)
# Height of the tissue under the tips: 2 cm below the jaw axes at home.
TISSUE_TOP = 0.182
FRAME_X, POST_Y, TOP = 0.283, (-0.14, 0.24), 0.56

MATERIALS = {  # rgba, specular, shininess, reflectance
    "black": ("0.085 0.085 0.092 1", 0.35, 0.3, 0),
    "gunmetal": ("0.16 0.16 0.17 1", 0.5, 0.5, 0),
    "pulley": ("0.34 0.35 0.37 1", 0.6, 0.5, 0),
    "silver": ("0.66 0.68 0.70 1", 0.55, 0.45, 0),
    "steel": ("0.90 0.92 0.94 1", 1.0, 0.7, 0),
    "extrusion": ("0.72 0.74 0.76 1", 0.4, 0.4, 0),
    "groove": ("0.44 0.46 0.48 1", 0.2, 0.2, 0),
    "cable": ("0.93 0.93 0.91 1", 0.2, 0.2, 0),
    "wood": ("1 1 1 1", 0.1, 0.1, 0),
    "floor": ("1 1 1 1", 0.05, 0.05, 0),
    "stand": ("0.80 0.83 0.86 1", 0.2, 0.3, 0),
    "tray": ("0.90 0.92 0.93 1", 0.4, 0.4, 0.05),
    "tissue": ("0.93 0.62 0.56 1", 0.45, 0.55, 0),
    "vessel": ("0.66 0.09 0.11 1", 0.7, 0.7, 0),
    "vein": ("0.33 0.25 0.52 1", 0.6, 0.6, 0),
    "peg": ("0.95 0.94 0.90 1", 0.3, 0.4, 0),
    "ring_red": ("0.90 0.35 0.24 1", 0.4, 0.5, 0),
    "ring_blue": ("0.22 0.50 0.80 1", 0.4, 0.5, 0),
    "ring_yellow": ("0.96 0.76 0.22 1", 0.4, 0.5, 0),
}


def surface(x, y) -> np.ndarray:
    """Return the height of the tissue: a gentle dome with soft folds and a rounded rim."""
    dome = 0.012 * (1 - (x / 0.085) ** 2 - 0.7 * (y / 0.07) ** 2)
    folds = 0.0012 * np.sin(95 * x + 40 * y) * np.cos(70 * y - 30 * x) + 0.0008 * np.sin(
        150 * y + 60 * x
    )
    edge = np.maximum(np.abs(x) / 0.075, np.abs(y) / 0.060)
    rim = 0.010 * np.clip((edge - 0.86) / 0.14, 0, 1) ** 2
    return TISSUE_TOP - 0.012 + dome + folds - rim


def tissue() -> Mesh:
    x, y = np.meshgrid(
        np.linspace(-0.075, 0.075, 61), np.linspace(-0.060, 0.060, 49), indexing="ij"
    )
    return Mesh().slab(np.stack([x, y, surface(x, y)], axis=-1), TISSUE_TOP - 0.030)


def _on_tissue(path, depth: float, count: int = 60) -> np.ndarray:
    curve = smooth([(x, y, 0.0) for x, y in path], count)
    curve[:, 2] = surface(curve[:, 0], curve[:, 1]) - depth
    return curve


def vessel() -> Mesh:
    trunk = [
        (-0.073, -0.024),
        (-0.045, -0.016),
        (-0.015, -0.004),
        (0.012, 0.002),
        (0.040, 0.018),
        (0.073, 0.022),
    ]
    branch = [(0.012, 0.002), (0.028, -0.010), (0.046, -0.030), (0.058, -0.058)]
    mesh = Mesh().tube(_on_tissue(trunk, 0.0004, 90), 0.0031, 20)
    return mesh.tube(_on_tissue(branch, 0.0004, 60), np.linspace(0.0022, 0.0014, 60), 16)


def vein() -> Mesh:
    path = [(-0.050, 0.058), (-0.034, 0.034), (-0.030, 0.010), (-0.015, -0.018), (-0.018, -0.058)]
    return Mesh().tube(_on_tissue(path, 0.0007, 90), 0.0017, 16)


def ring() -> Mesh:
    turns = np.linspace(0, 2 * np.pi, 33)
    path = np.column_stack([0.0085 * np.cos(turns), 0.0085 * np.sin(turns), np.zeros(33)])
    return Mesh().tube(path, 0.0018, 10)


MESHES: dict[str, Callable[[], Mesh]] = {
    "tissue": tissue,
    "vessel": vessel,
    "vein": vein,
    "ring": ring,
}


def write_meshes(folder: Path) -> None:
    for name, make in MESHES.items():
        make().write(folder / f"{name}.obj")


def _add(parent: ET.Element, tag: str, **attributes: object) -> ET.Element:
    names = {"kind": "class"}
    return ET.SubElement(parent, tag, {names.get(k, k): str(v) for k, v in attributes.items()})


def add_settings(root: ET.Element) -> None:
    visual = _add(root, "visual")
    _add(visual, "global", azimuth=90, elevation=-22, fovy=38, offwidth=2560, offheight=1600)
    _add(visual, "quality", shadowsize=8192, offsamples=8, numslices=48)
    _add(visual, "map", znear=0.02, zfar=12, shadowclip=1.1, haze=0.45)
    _add(
        visual,
        "headlight",
        ambient="0.40 0.40 0.42",
        diffuse="0.20 0.20 0.20",
        specular="0.08 0.08 0.08",
    )
    _add(visual, "rgba", haze="0.87 0.89 0.91 1")
    _add(root, "statistic", center="0 0 0.28", extent=1.2)
    default = _add(root, "default")
    shapes = _add(default, "default", kind="visual")
    _add(shapes, "geom", contype=0, conaffinity=0, mass=0, group=2)
    _add(shapes, "mesh", inertia="shell")


def add_assets(assets: ET.Element) -> None:
    _add(
        assets,
        "texture",
        name="sky",
        type="skybox",
        builtin="gradient",
        rgb1="0.80 0.84 0.89",
        rgb2="0.90 0.91 0.92",
        width=256,
        height=256,
    )
    _add(
        assets,
        "texture",
        name="floor",
        type="2d",
        builtin="flat",
        rgb1="0.72 0.73 0.75",
        width=64,
        height=64,
    )
    _add(
        assets,
        "texture",
        name="wood",
        type="2d",
        builtin="flat",
        rgb1="0.74 0.65 0.52",
        width=64,
        height=64,
    )
    for name, (rgba, specular, shininess, reflectance) in MATERIALS.items():
        extra = {"texture": name} if name in ("wood", "floor") else {}
        _add(
            assets,
            "material",
            name=name,
            rgba=rgba,
            specular=specular,
            shininess=shininess,
            reflectance=reflectance,
            **extra,
        )
    for name in MESHES:
        smooth_normals = {} if name == "tissue" else {"smoothnormal": "true"}
        _add(assets, "mesh", name=name, kind="visual", file=f"{name}.obj", **smooth_normals)


def add_world(world: ET.Element) -> None:
    light = {"castshadow": "true", "specular": "0.35 0.35 0.35"}
    _add(
        world,
        "light",
        name="lamp",
        pos="-0.25 -1.1 1.5",
        dir="0.16 0.72 -0.95",
        diffuse="0.52 0.51 0.49",
        type="directional",
        **light,
    )
    _add(
        world,
        "light",
        name="fill",
        pos="0.9 -0.4 1.6",
        dir="-0.6 0.25 -0.9",
        diffuse="0.24 0.25 0.28",
        castshadow="false",
        specular="0.1 0.1 0.1",
        type="directional",
    )
    _add(
        world,
        "geom",
        name="floor",
        type="plane",
        size="0 0 0.1",
        pos="0 0 -0.03",
        material="floor",
        kind="visual",
    )
    _board(world)
    _frames(world)
    _phantom(world)
    _camera(world, "theatre", (0.75, -1.62, 0.98), (0.0, 0.02, 0.43), 36)
    _camera(world, "front", (0, -1.85, 0.66), (0, 0, 0.43), 36)
    _camera(world, "closeup", (0.06, -0.20, 0.275), (0, 0, 0.196), 34)


def _camera(world: ET.Element, name: str, eye: tuple, target: tuple, fovy: float) -> None:
    away = np.array(eye, dtype=float) - np.array(target, dtype=float)
    away /= np.linalg.norm(away)
    right = np.cross((0, 0, 1), away)
    right /= np.linalg.norm(right)
    axes = " ".join(f"{x:.6g}" for x in (*right, *np.cross(away, right)))
    _add(world, "camera", name=name, pos=" ".join(str(x) for x in eye), xyaxes=axes, fovy=fovy)


def _block(world: ET.Element, center, size, material: str) -> None:
    _add(
        world,
        "geom",
        type="box",
        kind="visual",
        material=material,
        pos=" ".join(f"{x:.6g}" for x in center),
        size=" ".join(f"{x / 2:.6g}" for x in size),
    )


def _board(world: ET.Element) -> None:
    tones = (0.98, 1.0, 0.95, 1.0, 0.97, 0.99)
    for k, tone in enumerate(tones):
        y = -0.36 + 0.15 * k
        _add(
            world,
            "geom",
            type="box",
            kind="visual",
            material="wood",
            rgba=f"{tone} {tone} {tone * 0.985:.4g} 1",
            pos=f"0 {y:.6g} 0",
            size="0.72 0.0745 0.018",
        )


def _extrusion(world: ET.Element, start, end, width: float = 0.04) -> None:
    """Add a square aluminium profile with a dark groove on each face."""
    start, end = np.array(start), np.array(end)
    along = np.argmax(np.abs(end - start))
    center, size = (start + end) / 2, np.full(3, width)
    size[along] = abs(end - start)[along]
    _block(world, center, size, "extrusion")
    for axis in {0, 1, 2} - {int(along)}:
        groove = size.copy()
        groove[axis] = width + 0.0012
        groove[[a for a in range(3) if a not in (axis, along)]] = 0.009
        groove[along] -= 0.002
        _block(world, center, groove, "groove")


def _frames(world: ET.Element) -> None:
    bottom = 0.018
    for x in (-FRAME_X - 0.03, FRAME_X + 0.03):
        for y in POST_Y:
            _extrusion(world, (x, y, bottom), (x, y, TOP))
        for z in (bottom + 0.02, 0.188, TOP + 0.02):
            pad = 0.02 if z > TOP else -0.02
            _extrusion(world, (x, POST_Y[0] - pad, z), (x, POST_Y[1] + pad, z))
        _extrusion(world, (x + np.sign(x) * 0.02, 0.0, 0.188), (x + np.sign(x) * 0.20, 0.0, 0.188))
        for y in POST_Y:
            _block(world, (x - np.sign(x) * 0.03, y, bottom + 0.014), (0.02, 0.04, 0.028), "black")
    y = POST_Y[1]
    _extrusion(world, (-FRAME_X - 0.01, y, TOP + 0.02), (FRAME_X + 0.01, y, TOP + 0.02))


def _phantom(world: ET.Element) -> None:
    _block(world, (0, 0, 0.022), (0.20, 0.17, 0.010), "stand")
    _block(world, (0, 0, 0.083), (0.070, 0.070, 0.115), "stand")
    _block(world, (0, 0, TISSUE_TOP - 0.036), (0.235, 0.175, 0.012), "tray")
    for name in ("tissue", "vessel", "vein"):
        _add(world, "geom", name=name, type="mesh", mesh=name, material=name, kind="visual")
    top = TISSUE_TOP - 0.030
    for k, (x, y) in enumerate((x, y) for x in (-0.095, 0.095) for y in (-0.06, 0.0, 0.06)):
        _add(
            world,
            "geom",
            type="cylinder",
            kind="visual",
            material="peg",
            size="0.003 0.011",
            pos=f"{x} {y} {top + 0.011:.6g}",
        )
        if k in (0, 2, 4):
            material = ("ring_red", "", "ring_blue", "", "ring_yellow")[k]
            _add(
                world,
                "geom",
                type="mesh",
                mesh="ring",
                kind="visual",
                material=material,
                pos=f"{x} {y} {top + 0.002:.6g}",
            )
    _add(
        world, "site", name="tissue_top", pos=f"0 0 {surface(0.0, 0.0):.6g}", size="0.001", group=4
    )
