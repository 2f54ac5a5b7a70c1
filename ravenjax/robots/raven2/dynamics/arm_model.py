"""The MuJoCo model of the robot, loaded once per process."""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import functools
from typing import TYPE_CHECKING

import numpy as np

from ravenjax import resources
from ravenjax.robots.raven2.arms import JOINTS, ArmName

if TYPE_CHECKING:
    import mujoco

MODEL = "raven2/raven2.xml"


@functools.cache
def operating_scene() -> "mujoco.MjModel":
    """Return the compiled model of both arms and the scene. Callers share it: do not change it."""
    # Imported late, because code from the cache needs no model.
    import mujoco

    return mujoco.MjModel.from_xml_path(str(resources.find_model(MODEL)))


@functools.cache
def one_arm(arm: ArmName) -> "mujoco.MjModel":
    """Return an arm's compiled model without shapes and scene. Degrees of freedom: `JOINTS`."""
    return one_arm_spec(arm).compile()


def one_arm_spec(arm: ArmName) -> "mujoco.MjSpec":
    """Return the model of `one_arm` before it is compiled."""
    import mujoco

    spec = mujoco.MjSpec.from_file(str(resources.find_model(MODEL)))
    for key in list(spec.keys):  # a stored pose has numbers for the joints of both arms
        spec.delete(key)
    for geom in list(spec.geoms):
        spec.delete(geom)
    for body in list(spec.worldbody.bodies):
        if body.name != base_body(arm):
            spec.delete(body)
    for unused in (*spec.meshes, *spec.materials, *spec.textures):
        spec.delete(unused)
    return spec


def base_body(arm: ArmName) -> str:
    """Return the name of the fixed body whose frame is the arm's frame 0."""
    return f"{arm}_frame0"


def joint_names(arm: ArmName) -> tuple[str, ...]:
    """Return the names of the arm's joints in the model, in the order of `JOINTS`."""
    return tuple(f"{arm}_{joint}" for joint in JOINTS)


def frame_rotation(arm: ArmName) -> np.ndarray:
    """Return the rotation [3, 3] of the arm's frame 0 in the world."""
    from ravenjax.mechanics.rigid_tree import rotation_matrix  # imports MuJoCo

    return rotation_matrix(operating_scene().body(base_body(arm)).quat)
