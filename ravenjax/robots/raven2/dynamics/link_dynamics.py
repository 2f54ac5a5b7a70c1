"""Rigid-body dynamics of one arm: M(q) qacc + bias(q, qvel) = joint torque.

`setup.link_dynamics` selects one of two implementations of the same quantities. "unrolled" replays
a straight-line program derived from the compiled model; "mjx" calls mujoco.mjx. Joint order and
units: `raven2.arms.JOINTS`, rad and m.
"""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

from ravenjax.ir.program import Program
from ravenjax.ir.symbolic import replay
from ravenjax.numbers.algebra import mul
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.robots.raven2.setup import RavenSetup

if TYPE_CHECKING:
    from ravenjax.robots.raven2.dynamics.rigid_tree import Link

FUNCTIONS = {"sin": lambda x: jnp.sin(x), "cos": lambda x: jnp.cos(x)}
"""Functions that the program calls."""


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
        from ravenjax.robots.raven2.dynamics import (
            # this import takes half a second, which only this choice should cost
            mjx_dynamics,
        )

        mass, bias = mjx_dynamics.mass_matrix_and_bias(arm, qpos, qvel, gravity)
    else:
        mass, bias = _unrolled(arm, qpos, qvel, gravity)
    mass = [[mul(x, mass_scale) for x in row] for row in mass]
    bias = [mul(x, mass_scale) for x in bias]
    for i, link in enumerate(links(arm)):
        if link.armature:
            mass[i][i] = mass[i][i] + link.armature
    return tuple(Vec(row) for row in mass), Vec(bias)


@functools.cache
def links(arm: ArmName) -> tuple[Link, ...]:
    """Return the arm as a tree of links. Raises ValueError if the model's joints are not those of
    the arm.
    """
    from ravenjax.robots.raven2.dynamics.rigid_tree import read_tree  # imports MuJoCo

    tree = read_tree(arm_model.one_arm(arm), arm_model.base(arm))
    joints, expected = tuple(link.joint for link in tree), arm_model.joint_names(arm)
    if joints != expected:
        raise ValueError(
            f"{arm_model.MODEL}: joints below {arm_model.base(arm)} are {joints}, expected"
            f" {expected}"
        )
    return tree


@functools.lru_cache(maxsize=64)
def program(arm: ArmName, known: tuple[float | None, ...]) -> Program:
    """Return the arm's straight-line program; `known` as in
    `rigid_program.mass_matrix_and_bias`.
    """
    from ravenjax.robots.raven2.dynamics import rigid_program

    return rigid_program.mass_matrix_and_bias(links(arm), known)


def _unrolled(
    arm: ArmName, qpos: Vec, qvel: Vec, gravity: Vec
) -> tuple[list[list[Scalar]], list[Scalar]]:
    inputs = (*qpos, *qvel, *gravity)
    constants = tuple(float(x) if type(x) in (int, float) else None for x in inputs)
    out = replay(program(arm, constants), inputs, FUNCTIONS)
    n = len(qpos)
    triangle = [out[i * (i + 1) // 2 : (i + 1) * (i + 2) // 2] for i in range(n)]
    return [[triangle[max(i, j)][min(i, j)] for j in range(n)] for i in range(n)], out[-n:]
