"""Mass matrix and bias of one arm by mujoco.mjx: the reference for the unrolled program."""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import contextlib
import functools
import io

import jax
import jax.numpy as jnp
import numpy as np

with contextlib.redirect_stdout(
    io.StringIO()
    # the import prints a line for each optional backend that is not installed
):
    from mujoco import mjx

from ravenjax.numbers.vec import Scalar, Vec
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.dynamics import arm_model


def mass_matrix_and_bias(
    arm: ArmName, qpos: Vec, qvel: Vec, gravity: Vec
) -> tuple[list[list[Scalar]], list[Scalar]]:
    """Return (M without armature: 7 x 7, bias: 7); arguments as in
    `link_dynamics.mass_matrix_and_bias`.

    Computes in the floating-point type of the arguments; also works under jit and vmap.
    """
    dtype = jnp.result_type(*qpos, *qvel, *gravity)
    dtype = dtype if jnp.issubdtype(dtype, jnp.floating) else jnp.result_type(float)
    model, data, to_world = _at_rest(arm, str(dtype))
    down = jnp.stack([jnp.asarray(x, dtype) for x in gravity])
    model = model.replace(opt=model.opt.replace(gravity=jnp.asarray(to_world, dtype) @ down))
    data = data.replace(
        qpos=jnp.stack([jnp.asarray(x, dtype) for x in qpos]),
        qvel=jnp.stack([jnp.asarray(x, dtype) for x in qvel]),
    )
    data = mjx.com_pos(model, mjx.kinematics(model, data))
    data = mjx.rne(model, mjx.com_vel(model, mjx.crb(model, data)))
    # MJX widens numbers if x64 is on
    mass, bias = (x.astype(dtype) for x in (mjx.full_m(model, data), data.qfrc_bias))
    n = len(qpos)
    return [[mass[i, j] for j in range(n)] for i in range(n)], [bias[i] for i in range(n)]


@functools.cache
def _at_rest(arm: ArmName, dtype: str) -> tuple[mjx.Model, mjx.Data, np.ndarray]:
    """Return model and data for reals of type `dtype`, and the rotation of frame 0 in the world."""
    compiled = arm_model.one_arm(arm)
    with jax.ensure_compile_time_eval():
        model = mjx.put_model(compiled)
        model = model.replace(dof_armature=jnp.zeros_like(model.dof_armature))
        data = mjx.make_data(compiled)
    return model, data, arm_model.frame_rotation(arm)
