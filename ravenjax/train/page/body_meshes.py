"""Shapes of the robot and its surroundings out of the MuJoCo model, as glTF that viser takes.

Made once and kept on disk, see `kept_meshes`.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import math

import mujoco
import numpy as np
import trimesh
from mjviser import conversions
from trimesh.visual import TextureVisuals
from trimesh.visual.material import PBRMaterial

from ravenjax.train.page import bodies

DEFAULT = 0.5
"""Of a geom's own colour in MuJoCo: it has none, and its material's counts."""
CREASE = math.radians(35.0)
"""Faces that meet at less are drawn as one smooth surface."""


def coloured(model: mujoco.MjModel, body: int) -> bytes:
    """The body's shapes in its frame, m, a mesh for each look, as binary glTF."""
    scene = trimesh.Scene()
    for look, geoms in _looks(model, body).items():
        mesh = trimesh.graph.smooth_shade(conversions.merge_geoms(model, geoms), angle=CREASE)
        mesh.visual = TextureVisuals(material=_material(model, geoms[0]))
        scene.add_geometry(mesh, geom_name=str(look))
    data = scene.export(file_type="glb")
    assert isinstance(data, bytes)
    return data


def plain(model: mujoco.MjModel, body: int) -> trimesh.Trimesh:
    """The same shapes as one mesh without colour."""
    mesh = conversions.merge_geoms(model, bodies.geoms(model, body))
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)


def looks(model: mujoco.MjModel, body: int) -> list[list[int]]:
    """Geoms of a body that look alike, together."""
    return list(_looks(model, body).values())


def colour(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Of a geom, sRGB, 0 to 1."""
    material = model.mat(int(model.geom_matid[geom]))
    textured = [int(i) for i in material.texid if i >= 0]
    own = model.geom_rgba[geom][:3]
    plain = material.rgba[:3] if np.allclose(own, DEFAULT) else own
    return _flat(model, textured[0]) * own if textured else plain


def _looks(model: mujoco.MjModel, body: int) -> dict[tuple[float, ...], list[int]]:
    geoms: dict[tuple[float, ...], list[int]] = {}
    for geom in bodies.geoms(model, body):
        look = (float(model.geom_matid[geom]), *model.geom_rgba[geom].round(3).tolist())
        geoms.setdefault(look, []).append(geom)
    return geoms


def _material(model: mujoco.MjModel, geom: int) -> PBRMaterial:
    """MuJoCo's colour and gloss as glTF has them: colours linear, roughness in place of
    shininess.
    """
    number = int(model.geom_matid[geom])
    material = model.mat(number)
    metal = material.name in ("steel", "silver", "extrusion")
    return PBRMaterial(
        baseColorFactor=[*_linear(colour(model, geom)).tolist(), 1.0],
        metallicFactor=0.55 if metal else 0.0,
        roughnessFactor=float(np.clip(0.95 - 0.75 * material.shininess[0], 0.2, 1.0)),
        doubleSided=True,
    )


def _flat(model: mujoco.MjModel, texture: int) -> np.ndarray:
    """The colour of a texture that has one, 0 to 1."""
    start = int(model.tex_adr[texture])
    return model.tex_data[start : start + 3] / 255.0


def _linear(colour: np.ndarray) -> np.ndarray:
    """Of sRGB."""
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4)
