"""Rigid-body dynamics of one arm: M(q) qacc + bias(q, qvel) = joint torque.

`setup.link_dynamics` selects one of two implementations of the same quantities. "unrolled" replays
a straight-line program derived from the compiled model; "mjx" calls mujoco.mjx. Joint order and
units: `raven2.arms.JOINTS`, rad and m.
"""

from __future__ import annotations

import contextlib
import functools
import io
from typing import TYPE_CHECKING, Any

from ravenjax.ir.program import Program
from ravenjax.mechanics import rigid_program
from ravenjax.numbers.algebra import mul
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Scalar, Vec
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.robots.raven2.setup import RavenSetup

if TYPE_CHECKING:
    from ravenjax.mechanics.rigid_tree import Link


def mass_matrix_and_bias(
    setup: RavenSetup, arm: ArmName, qpos: Vec, qvel: Vec, gravity: Vec, mass_scale: Scalar = 1.0
) -> tuple[tuple[Vec, ...], Vec]:
    """Return (M: 7 rows of 7, bias: 7) at joint positions `qpos` (= jpos) and velocities `qvel`.

    gravity: m/s^2 in frame 0 of the arm. bias: Coriolis, centrifugal and gravity torque (Nm,
    insertion N), with the sign of MuJoCo's qfrc_bias. mass_scale multiplies every link's mass and
    inertia. Both results are linear in it and are scaled at the end, except the armature (kg m^2)
    of the tool spindles on the diagonal. Entries of M that never change are Python numbers. Python
    numbers among the arguments are folded as constants.
    """
    if setup.link_dynamics == "mjx":
        mass, bias = _by_mjx(arm, qpos, qvel, gravity)
    else:
        program = functools.partial(arm_program, arm)
        mass, bias = rigid_program.evaluate_program(program, (*qpos, *qvel, *gravity))
    mass = [[mul(x, mass_scale) for x in row] for row in mass]
    bias = [mul(x, mass_scale) for x in bias]
    for i, link in enumerate(arm_links(arm)):
        if link.armature:
            mass[i][i] = mass[i][i] + link.armature
    return tuple(Vec(row) for row in mass), Vec(bias)


def _by_mjx(
    arm: ArmName, qpos: Vec, qvel: Vec, gravity: Vec
) -> tuple[list[list[Scalar]], list[Scalar]]:
    dtype = jnp.result_type(*qpos, *qvel, *gravity)
    dtype = dtype if jnp.issubdtype(dtype, jnp.floating) else jnp.result_type(float)
    mjx, model, data = _mjx_model(arm, str(dtype))
    down = jnp.asarray(arm_model.frame_rotation(arm), dtype) @ jnp.array(gravity, dtype)
    model = model.replace(opt=model.opt.replace(gravity=down))
    data = data.replace(qpos=jnp.array(qpos, dtype), qvel=jnp.array(qvel, dtype))
    data = mjx.com_pos(model, mjx.kinematics(model, data))
    data = mjx.rne(model, mjx.com_vel(model, mjx.crb(model, data)))
    # MJX widens numbers if x64 is on
    mass, bias = (x.astype(dtype) for x in (mjx.full_m(model, data), data.qfrc_bias))
    return [list(row) for row in mass], list(bias)


@functools.cache
def _mjx_model(arm: ArmName, dtype: str) -> tuple[Any, Any, Any]:
    """Return module `mjx`, the arm's model without armature, and its data, for reals of type
    `dtype`.
    """
    # The import takes half a second and prints a line for each optional backend that is missing.
    with contextlib.redirect_stdout(io.StringIO()):
        from mujoco import mjx
    compiled = arm_model.one_arm(arm)
    with jax.ensure_compile_time_eval():
        model = mjx.put_model(compiled)
        return mjx, model.replace(dof_armature=model.dof_armature * 0.0), mjx.make_data(compiled)


@functools.cache
def arm_links(arm: ArmName) -> tuple[Link, ...]:
    """Return the arm as a tree of links. Raises ValueError if the model's joints are not those of
    the arm.
    """
    from ravenjax.mechanics.rigid_tree import read_tree  # imports MuJoCo

    tree = read_tree(arm_model.one_arm(arm), arm_model.base_body(arm))
    joints, expected = tuple(link.joint for link in tree), arm_model.joint_names(arm)
    if joints != expected:
        raise ValueError(
            f"{arm_model.MODEL}: joints below {arm_model.base_body(arm)} are {joints}, expected"
            f" {expected}"
        )
    return tree


@functools.lru_cache(maxsize=64)
def arm_program(arm: ArmName, known: tuple[float | None, ...]) -> Program:
    """Return the arm's straight-line program; `known` as in
    `rigid_program.mass_matrix_and_bias`.
    """
    return rigid_program.mass_matrix_and_bias(arm_links(arm), known)
