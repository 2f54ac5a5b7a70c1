"""Describes the shapes of the robot and its surroundings as JSON, for the explorer's page.

The page computes the poses of the bodies from joint positions and the tree of bodies.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import base64
from typing import Any

import mujoco
import numpy as np
import trimesh

from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.dynamics import arm_model, body_shapes, scene_views
from ravenjax.store import files

STEPS = 65535
"""Steps of a coordinate over the extent of a mesh: for 1 m, a step is 15 um."""
KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): "hinge", int(mujoco.mjtJoint.mjJNT_SLIDE): "slide"}


def describe_figure() -> dict[str, Any]:
    """Return JSON of the bodies in the model's order, parents first, and of the cameras.

    A body has: parent (index, -1: none), position (m) and quaternion (w first) in its parent,
    `joint` (arm, index, kind, axis, anchor, home) or null, and meshes. A mesh has: colour (sRGB, 0
    to 1), `low` and `size` (m) of a box, `corners` and `faces` (base64 of little-endian uint16 [n,
    3]). A corner is at low + size * corner / STEPS.
    """
    model = arm_model.operating_scene()
    joints = {
        int(model.joint(name).id): (arm, index)
        for arm in ARMS
        for index, name in enumerate(arm_model.joint_names(arm))
    }
    content = {
        "steps": STEPS,
        "bodies": [_body(model, body, joints) for body in range(model.nbody)],
        "cameras": {
            name: {"place": place, "focus": focus, "fov": fov}
            for name in scene_views.VIEWS
            for place, focus, fov in [scene_views.view_pose(name)]
        },
    }
    return files.json_values(content)


def _body(model: mujoco.MjModel, body: int, joints: dict[int, tuple[str, int]]) -> dict[str, Any]:
    return {
        "name": model.body(body).name,
        "parent": model.body_parentid[body] if body else -1,
        "position": model.body_pos[body],
        "quaternion": model.body_quat[body],
        "joint": (
            _joint(model, int(model.body_jntadr[body]), joints) if model.body_jntnum[body] else None
        ),
        "meshes": [_mesh(model, geoms) for geoms in body_shapes.geoms_by_look(model, body)],
    }


def _joint(model: mujoco.MjModel, joint: int, joints: dict[int, tuple[str, int]]) -> dict[str, Any]:
    arm, index = joints[joint]
    return {
        "arm": arm,
        "index": index,
        "kind": KINDS[int(model.jnt_type[joint])],
        "axis": model.jnt_axis[joint],
        "anchor": model.jnt_pos[joint],
        "home": model.key("home").qpos[model.jnt_qposadr[joint]],
        "zero": model.qpos0[model.jnt_qposadr[joint]],
    }


def _mesh(model: mujoco.MjModel, geoms: list[int]) -> dict[str, Any]:
    # Corners are whole numbers of steps within the mesh's box, which makes pages small.
    mesh = body_shapes.merged_mesh(model, geoms)
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    corners = np.asarray(mesh.vertices, float)
    low = corners.min(axis=0)
    size = np.maximum(corners.max(axis=0) - low, 1e-9)
    return {
        "colour": [round(float(part), 3) for part in body_shapes.geom_colour(model, geoms[0])],
        "low": low,
        "size": size,
        "corners": _words(np.rint((corners - low) / size * STEPS)),
        "faces": _words(mesh.faces),
    }


def _words(numbers: np.ndarray) -> str:
    assert numbers.min() >= 0 and numbers.max() <= STEPS, numbers.max()
    return base64.b64encode(np.ascontiguousarray(numbers, "<u2").tobytes()).decode()
