"""Describes the shapes of the robot and its surroundings as JSON, for the explorer's page.

The page computes the poses of the bodies from the joint positions and from the tree of bodies.
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
"""Number of steps into which a coordinate of a mesh is divided: for 1 m, a step is 15 um."""
JOINT_KINDS = {int(mujoco.mjtJoint.mjJNT_HINGE): "hinge", int(mujoco.mjtJoint.mjJNT_SLIDE): "slide"}


def describe_figure() -> dict[str, Any]:
    """Return JSON of the bodies in the model's order, parents first, and of the cameras.

    A body has: parent (index, -1: none), position (m) and quaternion (w first) in its parent,
    `joint` (arm, index, kind, axis, anchor, home, zero) or null, and meshes. `home` (rad, m) is the
    joint's position in the robot's home pose. At the joint's position `zero`, the body has the
    stated position and quaternion. A mesh has: colour (sRGB, 0 to 1), `low` and `size` (m) of a
    box, `corners` and `faces` (base64 of little-endian uint16 [n, 3]). A corner is at low + size *
    corner / STEPS.
    """
    model = arm_model.operating_scene()
    # MuJoCo's number of each joint -> its arm, and its index in the arm
    joints = {
        int(model.joint(name).id): (arm, index)
        for arm in ARMS
        for index, name in enumerate(arm_model.joint_names(arm))
    }
    bodies = [_describe_body(model, body, joints) for body in range(model.nbody)]
    cameras = {}
    for name in scene_views.VIEWS:
        position, focus, fov = scene_views.view_pose(name)
        cameras[name] = {"place": position, "focus": focus, "fov": fov}
    return files.json_values({"steps": STEPS, "bodies": bodies, "cameras": cameras})


def _describe_body(
    model: mujoco.MjModel, body: int, joints: dict[int, tuple[str, int]]
) -> dict[str, Any]:
    # Returns the description of a body. joints: a joint's number -> its arm, its index in the arm.
    # Each body of this model has at most one joint
    has_joint = model.body_jntnum[body] > 0
    joint = int(model.body_jntadr[body])
    return {
        "name": model.body(body).name,
        "parent": model.body_parentid[body] if body else -1,  # body 0 is the world
        "position": model.body_pos[body],
        "quaternion": model.body_quat[body],
        "joint": _describe_joint(model, joint, *joints[joint]) if has_joint else None,
        "meshes": [_describe_mesh(model, geoms) for geoms in body_shapes.group_geoms(model, body)],
    }


def _describe_joint(model: mujoco.MjModel, joint: int, arm: str, index: int) -> dict[str, Any]:
    # Returns the description of a joint, with axis and anchor (m) in the frame of its body.
    return {
        "arm": arm,
        "index": index,
        "kind": JOINT_KINDS[int(model.jnt_type[joint])],
        "axis": model.jnt_axis[joint],
        "anchor": model.jnt_pos[joint],
        "home": model.key("home").qpos[model.jnt_qposadr[joint]],
        "zero": model.qpos0[model.jnt_qposadr[joint]],
    }


def _describe_mesh(model: mujoco.MjModel, geoms: list[int]) -> dict[str, Any]:
    # Returns the description of one mesh of these geoms, which all have the same colour.
    # Corners are whole numbers of steps within the mesh's box, which makes the page small
    mesh = body_shapes.merged_mesh(model, geoms)
    # process=True merges equal corners
    mesh = trimesh.Trimesh(mesh.vertices, mesh.faces, process=True)
    corners = np.asarray(mesh.vertices, float)
    low = corners.min(axis=0)
    # A flat mesh has no extent along one axis; the lower bound avoids a division by zero
    size = np.maximum(corners.max(axis=0) - low, 1e-9)
    return {
        "colour": [round(float(part), 3) for part in body_shapes.geom_colour(model, geoms[0])],
        "low": low,
        "size": size,
        "corners": _encode_uint16(np.rint((corners - low) / size * STEPS)),
        "faces": _encode_uint16(mesh.faces),
    }


def _encode_uint16(numbers: np.ndarray) -> str:
    # Returns the base64 text of whole numbers from 0 to 65535, as little-endian uint16.
    assert numbers.min() >= 0 and numbers.max() <= STEPS, numbers.max()
    return base64.b64encode(np.ascontiguousarray(numbers, "<u2").tobytes()).decode()
