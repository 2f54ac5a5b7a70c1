"""Extracts from the MuJoCo model what is drawn: bodies that move or not, their shapes and colours.

mjviser and trimesh are imported only when shapes are made, because the import takes a second.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import math
from typing import TYPE_CHECKING

import mujoco
import numpy as np

from ravenjax.robots.raven2.arms import ArmName

if TYPE_CHECKING:
    import trimesh

NO_COLOUR = 0.5
"""MuJoCo's value for each colour component of a geom without a colour."""
CREASE = math.radians(35.0)
"""Largest angle between neighbouring faces that are drawn as one smooth surface, rad."""


def fixed_bodies(model: mujoco.MjModel) -> dict[int, str]:
    """Return number and name of each body that has a shape and never moves."""
    # MuJoCo welds such bodies to body 0, the world
    return _drawn_bodies(model, np.flatnonzero(model.body_weldid == 0))


def moving_bodies(model: mujoco.MjModel, arm: ArmName) -> dict[int, str]:
    """Return number and name of each moving link of an arm that has a shape."""
    bodies = _drawn_bodies(model, np.flatnonzero(model.body_weldid != 0))
    return {body: name for body, name in bodies.items() if name.startswith(f"{arm}_")}


def _drawn_bodies(model: mujoco.MjModel, bodies: np.ndarray) -> dict[int, str]:
    # Returns number and name of those `bodies` (numbers) that have a shape.
    return {int(body): model.body(body).name for body in bodies if _drawn_geoms(model, body)}


def _drawn_geoms(model: mujoco.MjModel, body: int) -> list[int]:
    """Return the numbers of a body's geoms (shapes), without the unbounded floor."""
    geoms = np.flatnonzero(model.geom_bodyid == body).tolist()
    return [geom for geom in geoms if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_PLANE]


def group_geoms(model: mujoco.MjModel, body: int) -> list[list[int]]:
    """Return the numbers of a body's geoms, as one list for each material and colour."""
    geoms_by_look: dict[tuple[float, ...], list[int]] = {}
    for geom in _drawn_geoms(model, body):
        look = float(model.geom_matid[geom]), *model.geom_rgba[geom].round(3).tolist()
        geoms_by_look.setdefault(look, []).append(geom)
    return list(geoms_by_look.values())


def merged_mesh(model: mujoco.MjModel, geoms: list[int]) -> "trimesh.Trimesh":
    """Return one mesh of these geoms in their body's frame, m."""
    from mjviser import conversions

    return conversions.merge_geoms(model, geoms)


def plain_mesh(model: mujoco.MjModel, body: int) -> "trimesh.Trimesh":
    """Return the body's shapes as one mesh without colour, in its frame, m."""
    import trimesh

    mesh = merged_mesh(model, _drawn_geoms(model, body))
    return trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)


def coloured_glb(model: mujoco.MjModel, body: int) -> bytes:
    """Return a body's shapes in its frame, m, as binary glTF, one mesh for each appearance."""
    import trimesh
    from trimesh.visual import TextureVisuals
    from trimesh.visual.material import PBRMaterial

    scene = trimesh.Scene()
    for geoms in group_geoms(model, body):
        mesh = trimesh.graph.smooth_shade(merged_mesh(model, geoms), angle=CREASE)
        material = model.mat(int(model.geom_matid[geoms[0]]))
        srgb = geom_colour(model, geoms[0])
        # glTF has linear colours, and roughness instead of shininess. The numbers of the conversion
        # of shininess are chosen by eye
        linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
        is_metal = material.name in ("steel", "silver", "extrusion")
        mesh.visual = TextureVisuals(
            material=PBRMaterial(
                name=material.name,
                baseColorFactor=[*linear.tolist(), 1.0],
                metallicFactor=0.55 if is_metal else 0.0,
                roughnessFactor=float(np.clip(0.95 - 0.75 * material.shininess[0], 0.2, 1.0)),
                doubleSided=True,
            )
        )
        scene.add_geometry(mesh, geom_name=str(geoms[0]))
    data = scene.export(file_type="glb")
    assert isinstance(data, bytes)
    return data


def geom_colour(model: mujoco.MjModel, geom: int) -> np.ndarray:
    """Return the sRGB colour [3] of a geom, 0 to 1. A texture counts with its first pixel."""
    material = model.mat(int(model.geom_matid[geom]))
    rgb = model.geom_rgba[geom][:3]
    if textures := [int(texture) for texture in material.texid if texture >= 0]:
        start = int(model.tex_adr[textures[0]])
        return model.tex_data[start : start + 3] / 255.0 * rgb
    return material.rgba[:3] if np.allclose(rgb, NO_COLOUR) else rgb
