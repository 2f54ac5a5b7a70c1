"""Unrolled link dynamics and the linear solver against C MuJoCo and MJX."""

import copy
import functools

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest

from ravenjax.mechanics import rigid_program
from ravenjax.mechanics.rigid_tree import read_tree
from ravenjax.numbers.algebra import solve_spd
from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.robots.raven2.dynamics.link_dynamics import LEVERS, mass_matrix_and_bias, solve_by_mjx
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup

AXES = np.eye(3)


def random_tree(rng: np.random.Generator, bodies: int) -> mujoco.MjModel:
    """Fixed base in a random pose; bodies with 0-2 joints each, half of the axes along
    coordinates, valid inertias.
    """
    spec = mujoco.MjSpec()
    nodes = [spec.worldbody.add_body(name="base", pos=rng.normal(size=3), quat=rng.normal(size=4))]
    for i in range(bodies):
        body = nodes[rng.integers(len(nodes))].add_body(
            name=f"b{i}", pos=rng.normal(size=3), quat=rng.normal(size=4)
        )
        body.explicitinertial = True
        body.mass, body.ipos = rng.uniform(0.1, 2.0), rng.normal(size=3)
        body.iquat, body.inertia = rng.normal(size=4), rng.uniform(1.0, 1.9, size=3)
        for k in range(2 if i == 0 else rng.integers(0, 3)):
            body.add_joint(
                name=f"j{i}_{k}",
                type=(mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)[rng.integers(2)],
                axis=AXES[rng.integers(3)] if rng.random() < 0.5 else rng.normal(size=3),
                pos=rng.normal(size=3) if rng.random() < 0.5 else np.zeros(3),
                armature=rng.random(),
                ref=rng.normal(),
            )
        nodes.append(body)
    return spec.compile()


def mujoco_answer(
    model: mujoco.MjModel, qpos, qvel
) -> tuple[np.ndarray, np.ndarray, mujoco.MjData]:
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass, data.qfrc_bias.copy(), data


def relative(found: np.ndarray, expected: np.ndarray) -> float:
    return float(np.abs(np.asarray(found) - expected).max() / np.abs(expected).max())


@pytest.mark.parametrize("seed", range(12))
def test_random_trees_equal_mujoco(seed):
    rng = np.random.default_rng(seed)
    model = random_tree(rng, bodies=5)
    n = model.nv
    qpos, qvel, applied = rng.normal(size=(3, n))
    mass, bias, data = mujoco_answer(model, qpos, qvel)
    tree = read_tree(model, "base")
    gravity = data.body("base").xmat.reshape(3, 3).T @ model.opt.gravity
    with jax.enable_x64(True):
        program = functools.partial(rigid_program.mass_matrix_and_bias, tree)
        rows, out = rigid_program.evaluate_program(program, [*qpos, *qvel, *gravity])
        found = np.array(rows, float) + np.diag([link.armature for link in tree])
        acceleration = solve_spd(tuple(map(Vec, found)), Vec(applied - np.array(out)))
    assert relative(found, mass) < 1e-10
    assert relative(out, bias) < 1e-10
    data.qfrc_applied[:] = applied
    mujoco.mj_forward(model, data)
    assert relative(np.array(acceleration), data.qacc) < 1e-10


def within_range(rng: np.random.Generator, count: int) -> np.ndarray:
    low, high = arm_model.operating_scene().jnt_range[:7].T
    return rng.uniform(low, high, size=(count, 7))


@pytest.mark.parametrize("arm", ARMS)
def test_both_arms_equal_mujoco(arm):
    model = arm_model.operating_scene()
    first = 7 * ARMS.index(arm)
    own = slice(first, first + 7)
    rng = np.random.default_rng(7)
    q, v = within_range(rng, 10), rng.normal(size=(10, 7))

    @jax.jit
    @jax.vmap
    def printed(qpos, qvel):
        mass, bias = mass_matrix_and_bias(arm, Vec(qpos), Vec(qvel), Vec((-9.81, 0.0, 0.0)))
        return jnp.array(mass), jnp.array(bias)

    with jax.enable_x64(True):
        mass, bias = printed(q, v)
    for i in range(10):
        qpos, qvel = model.key_qpos[0].copy(), np.zeros(14)
        qpos[own], qvel[own] = q[i], v[i]
        expected_mass, expected_bias, _ = mujoco_answer(model, qpos, qvel)
        np.testing.assert_allclose(mass[i], expected_mass[own, own], rtol=1e-10, atol=1e-15)
        np.testing.assert_allclose(bias[i], expected_bias[own], rtol=1e-10, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("arm", ["gold", "green"])
def test_a_step_of_mjx_solves_the_printed_equations(arm):
    """In any gravity, with scaled masses and damping between any two joints."""
    rng, lever = np.random.default_rng(3), np.array(LEVERS)
    states = within_range(rng, 20), rng.normal(size=(20, 7)), 9.8 * rng.normal(size=(20, 3))
    root = rng.normal(size=(20, 7, 7))
    damping = 0.01 * np.outer(lever, lever) * (root @ root.transpose(0, 2, 1) + np.eye(7))
    inputs = *states, damping, 0.1 * lever * rng.normal(size=(20, 7))

    @jax.jit
    @jax.vmap
    def gained(qpos, qvel, gravity, damping, right):
        links = Vec(qpos), Vec(qvel), Vec(gravity), 1.3
        mass, _ = mass_matrix_and_bias(arm, *links)
        system = [damping[i] + jnp.array(row) / 1e-3 for i, row in enumerate(mass)]
        known = tuple(map(Vec, system)), Vec(right)
        return jnp.array(solve_spd(*known)), jnp.array(solve_by_mjx(arm, 1e-3, *known, *links))

    with jax.enable_x64(True):
        expected, found = gained(*inputs)
    assert found.dtype == np.float64
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-11)
    _, narrow = gained(*(jnp.asarray(x, jnp.float32) for x in inputs))
    assert narrow.dtype == np.float32
    # the forces of dampers that cancel have the digits of the fastest motor
    fastest = (lever * (np.abs(states[1]) + np.abs(expected))).max(axis=1, keepdims=True)
    assert (lever * np.abs(narrow - expected) / fastest).max() < 2e-6


@pytest.mark.slow
@pytest.mark.parametrize("arm", ARMS)
def test_an_arm_without_cables_moves_as_by_the_implicit_integrator_of_mujoco(arm):
    viscous = np.array([0.5, 0.5, 5.0, 1e-3, 1e-3, 1e-3, 1e-3])
    model = copy.copy(arm_model.one_arm(arm))
    model.opt.timestep, model.opt.integrator = 1e-3, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.gravity[:] = arm_model.frame_rotation(arm) @ [-9.81, 0.0, 0.0]
    model.dof_damping[:], model.jnt_limited[:] = viscous, 0
    data = mujoco.MjData(model)
    data.qpos[:] = HOME_JPOS
    setup, none = RavenSetup((arm,), precision=REFERENCE), Vec.full(7, 0.0)
    with jax.enable_x64(True):
        params = robot.params(setup, arm)
        state = robot.init(setup, arm, params, HOME_JPOS)
        loose = {"cable_stiffness": none, "cable_damping": none, "link_coulomb": none}
        params = replace(params, **loose, link_viscous=Vec(viscous))
        signal = robot.PlantSignal(Vec((jnp.int32(0),) * 7), jnp.int32(1))
        step = jax.jit(lambda state: robot.step(setup, arm, params, state, signal))
        for _ in range(100):
            state, out = step(state)
            mujoco.mj_step(model, data)
    np.testing.assert_allclose(out.jpos, data.qpos, rtol=0, atol=1e-12)
    assert np.abs(data.qpos - np.array(HOME_JPOS)).max() > 0.02
