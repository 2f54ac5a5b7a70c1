"""Rigid-body dynamics of one arm: M(q) qacc + bias(q, qvel) = joint torque.

A program without loops and branches, which is derived from the compiled model, computes M and bias.
With `setup.link_dynamics` "mjx", a step of MuJoCo MJX moves the links instead. Joint order and
units: `raven2.arms.JOINTS`, rad and m.
"""

# MuJoCo's compiled module carries no types.
# pyright: reportAttributeAccessIssue=false

import functools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ravenjax.ir.program import Program
from ravenjax.mechanics import rigid_program
from ravenjax.numbers.algebra import mul
from ravenjax.numbers.lazy import jax, jnp
from ravenjax.numbers.vec import Scalar, Vec
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.dynamics import arm_model

if TYPE_CHECKING:
    from ravenjax.mechanics.rigid_tree import Link

LEVERS = (138.0, 123.0, 2400.0, 5.4, 9.0, 9.0, 9.0)
"""Approximate motor angle per joint position, rad/rad (insertion: rad/m). With joints in these
units, the damping between two joints is no small difference of large numbers.
"""


def mass_matrix_and_bias(
    arm: ArmName, qpos: Vec, qvel: Vec, gravity: Vec, mass_scale: Scalar = 1.0
) -> tuple[tuple[Vec, ...], Vec]:
    """Return the mass matrix M (7 rows of 7) and the bias (7) at joints `qpos` and speeds `qvel`.

    bias: Coriolis, centrifugal and gravity torques (Nm, insertion N), with the sign of MuJoCo's
    qfrc_bias. gravity: m/s^2 in frame 0 of the arm. mass_scale: factor of every link's mass and
    inertia, but not of the armature, which is the inertia of the tool spindles. Entries of M that
    are constant are Python numbers. Python numbers as arguments become constants of the program.
    """
    program = functools.partial(arm_program, arm)
    mass, bias = rigid_program.evaluate_program(program, (*qpos, *qvel, *gravity))
    mass = [[mul(x, mass_scale) for x in row] for row in mass]
    bias = [mul(x, mass_scale) for x in bias]
    for i, link in enumerate(arm_links(arm)):
        if link.armature:
            mass[i][i] = mass[i][i] + link.armature
    return tuple(Vec(row) for row in mass), Vec(bias)


def solve_by_mjx(
    arm: ArmName,
    timestep: float,
    system: Sequence[Vec],
    right: Vec,
    qpos: Vec,
    qvel: Vec,
    gravity: Vec,
    mass_scale: Scalar,
) -> Vec:
    """Return the solution x of `system` x = `right` by one `mjx.step`: changes of the joint speeds.

    system: 7 x 7, lower triangle, M / timestep + D. right: N m, insertion N. MuJoCo computes M and
    takes D as dampers: a tendon for each pair of joints i and j gives D_ij, and a damper of each
    joint completes D_ii. The tendon has length L_i q_i + L_j q_j, where L is LEVERS, and damping
    D_ij / (L_i L_j). It also adds D_ij L_i / L_j to D_ii. The applied torques cancel the bias of
    MuJoCo and the forces of the dampers at the speed at the start of the step.
    """
    from ravenjax.mechanics.mechanism import advance_by_mjx  # imports MuJoCo

    real = functools.partial(jnp.array, dtype=jnp.result_type(*right))
    model = _mjx_model(arm)
    mass, bias = mass_matrix_and_bias(arm, qpos, qvel, gravity, mass_scale)
    joints, levers, speed = range(len(right)), real(LEVERS), real(qvel)
    symmetric = real([[system[max(i, j)][min(i, j)] for j in joints] for i in joints])
    damping = symmetric - real(mass) / timestep
    pair_damping = damping / jnp.outer(levers, levers)
    # By default, GPUs round the numbers of a matrix product to 10 bits of mantissa
    with jax.default_matmul_precision("highest"):
        gravity_in_world = real(arm_model.frame_rotation(arm)) @ real(gravity)
        applied = real(right + bias) + damping @ speed
    options = {"timestep": timestep, "gravity": gravity_in_world}
    changes = {
        "body_mass": real(model.body_mass) * mass_scale,
        "body_inertia": real(model.body_inertia) * mass_scale,
        "tendon_damping": pair_damping[np.tril_indices(len(right), -1)],
        # D_ii less what the tendons add. The sum also contains D_ii itself, hence the factor 2
        "dof_damping": 2.0 * jnp.diagonal(damping) - levers * levers * pair_damping.sum(axis=1),
    }
    _, speed_after = advance_by_mjx(model, qpos, qvel, applied, options, **changes)
    # MJX returns float64 if JAX's 64-bit numbers are enabled
    return Vec((speed_after - speed).astype(speed.dtype))


@functools.cache
def _mjx_model(arm: ArmName) -> Any:
    """Return the arm's compiled model for MJX, with a tendon for each pair of joints. The tendon's
    damping, which `solve_by_mjx` sets, couples the speeds of the two joints.
    """
    import mujoco

    spec, names = arm_model.one_arm_spec(arm), arm_model.joint_names(arm)
    for i, j in zip(*np.tril_indices(len(names), -1), strict=True):
        tendon = spec.add_tendon()
        tendon.wrap_joint(names[i], LEVERS[i])
        tendon.wrap_joint(names[j], LEVERS[j])
        # Each step sets another damping. MuJoCo Warp ignores tendons that have none here.
        tendon.damping[0] = 1.0
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return spec.compile()


@functools.cache
def arm_links(arm: ArmName) -> "tuple[Link, ...]":
    """Return the arm as a tree of links. Raises ValueError if the model has other joints."""
    from ravenjax.mechanics.rigid_tree import read_tree  # imports MuJoCo

    tree = read_tree(arm_model.one_arm(arm), arm_model.base_body(arm))
    joints, expected = tuple(link.joint for link in tree), arm_model.joint_names(arm)
    if joints != expected:
        raise ValueError(
            f"{arm_model.MODEL}: the joints below body {arm_model.base_body(arm)} are {joints},"
            f" expected {expected}"
        )
    return tree


@functools.lru_cache(maxsize=64)
def arm_program(arm: ArmName, known: tuple[float | None, ...]) -> Program:
    """Return the program that computes M and bias of an arm from qpos, qvel and gravity. known: for
    each of these 17 numbers its value, if it is a constant of the program; None if it is an input.
    """
    return rigid_program.mass_matrix_and_bias(arm_links(arm), known)
