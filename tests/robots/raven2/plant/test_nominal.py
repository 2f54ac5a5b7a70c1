"""The nominal model: equation of motion against a stiff ODE solver, gains, tracking, targets."""

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import quickly
from scipy.integrate import solve_ivp

from ravenjax.numbers.setup import REFERENCE
from ravenjax.numbers.vec import Vec, replace
from ravenjax.robots.raven2.dynamics import link_dynamics
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.plant import nominal
from ravenjax.robots.raven2.setup import RavenSetup

SETUP = RavenSetup(precision=REFERENCE)
STILL = Vec((0.0, 0.0, 0.0, 1.0))


def smooth_targets(ticks: int) -> np.ndarray:
    """A surgical motion in joint space: about 20 mm/s at the tip, started smoothly."""
    time = np.arange(ticks)[:, None] * 1e-3
    ramp = np.clip(time / 0.5, 0, 1) ** 2 * (3 - 2 * np.clip(time / 0.5, 0, 1))
    amplitude = np.array([0.06, 0.06, 0.008, 0.3, 0.2, 0.2, 0.2])
    frequency = np.array([0.35, 0.45, 0.4, 0.3, 0.5, 0.4, 0.6])
    return np.array(HOME_JPOS) + ramp * amplitude * np.sin(2 * np.pi * frequency * time)


def clean(delta_um=(0, 0, 0), quat=STILL, grasp=0, engaged=1, setup=SETUP) -> nominal.Command:
    dtype = setup.precision.real
    return nominal.Command(
        delta_um=Vec(jnp.int32(x) for x in delta_um),
        quat=Vec(jnp.asarray(x, dtype) for x in quat),
        grasp_mrad=jnp.int32(grasp),
        engaged=jnp.int32(engaged),
    )


def by_targets(setup: RavenSetup, targets: np.ndarray, params=None) -> np.ndarray:
    params = params or nominal.params(setup)

    def tick(state, row):
        state = nominal.track_target("gold", params, state, Vec(row[i] for i in range(7)))
        return state, jnp.stack(state.jpos)

    start = nominal.init(setup, "gold", HOME_JPOS)
    rows = jnp.asarray(targets, setup.precision.real)
    return np.asarray(quickly.jit(lambda s, u: jax.lax.scan(tick, s, u))(start, rows)[1])


@pytest.mark.slow
def test_the_equation_of_motion_is_the_stated_one() -> None:
    """Without dry friction, against Radau on the equation as written."""
    with jax.enable_x64(True):
        params = replace(nominal.params(SETUP), kc=Vec.full(5, 0.0))
        targets = smooth_targets(700)
        ours = by_targets(SETUP, targets, params)

        @jax.jit
        def links(q, v):
            jaws = HOME_JPOS[5:]
            locked = Vec((*(q[i] for i in range(5)), *jaws))
            turning = Vec((*(v[i] for i in range(5)), 0.0, 0.0))
            # Of no consequence: the controller's G(q) cancels it.
            gravity_0 = Vec((-9.81, 0.0, 0.0))
            mass, bias = link_dynamics.mass_matrix_and_bias("gold", locked, turning, gravity_0)
            _, weight = link_dynamics.mass_matrix_and_bias(
                "gold", locked, Vec.full(7, 0.0), gravity_0
            )
            square = jnp.array([[mass[i][j] for j in range(5)] for i in range(5)])
            return square, jnp.stack(bias)[:5], jnp.stack(weight)[:5]

        kp, kd, kv = np.array(params.kp), np.array(params.kd), np.array(params.kv)

        def slope(_, x, target):
            q, v, integral = x[:7], x[7:14], x[14]
            mass, bias, weight = links(q, v)
            torque = kp * (target - q) - kd * v
            torque[2] += params.ki * integral
            links_accelerate = np.linalg.solve(mass, torque[:5] + weight - bias - kv * v[:5])
            return np.concatenate([v, links_accelerate, torque[5:], [target[2] - q[2]]])

        x = np.concatenate([np.array(HOME_JPOS, float), np.zeros(8)])
        exact = []
        for target in targets:
            x = solve_ivp(slope, (0, 1e-3), x, "Radau", args=(target,), rtol=1e-6, atol=1e-9).y[
                :, -1
            ]
            exact.append(x[:7])
    travel = np.ptp(targets, axis=0)
    assert (np.abs(ours - np.array(exact)).max(axis=0) < 0.005 * travel).all()


def run(setup: RavenSetup, commands: list, start=HOME_JPOS, measured=HOME_JPOS, resync=0):
    params = replace(nominal.params(setup), resync=np.int32(resync))
    begin = nominal.init(setup, "gold", start)
    state = jax.tree.map(lambda leaf: jnp.asarray(leaf, jnp.result_type(leaf)), begin)
    step = compiled_step(setup)
    for command in commands:
        state, out = step(params, state, command, Vec(map(float, measured)))
    return state, out


@functools.cache
def compiled_step(setup: RavenSetup):
    """A step of the model, compiled once for all tests of a setup."""
    return quickly.jit(
        lambda params, state, command, at: nominal.step(setup, "gold", params, state, command, at)
    )


@pytest.mark.slow
def test_it_follows_increments_to_where_they_lead() -> None:
    with jax.enable_x64(True):
        state, out = run(SETUP, [clean((20, -10, 5))] * 300 + [clean()] * 1200)
        start = np.array(kinematics.forward_pose("gold", HOME_JPOS).position)
        # ITP axes to frame 0 of gold: (-z, -x, y); um add up as whole numbers.
        expected = start + 300e-6 * np.array([-5, -20, -10])
        np.testing.assert_allclose(np.array(state.target.position_um) * 1e-6, expected, atol=2e-6)
        # Dry friction of the model's joints: it stops where a spring no longer moves it, 0.3 m from
        # the axes at most.
        params = nominal.params(SETUP)
        short = sum(
            float(params.kc[i] / params.kp[i]) * lever for i, lever in enumerate((0.3, 0.3, 1.0))
        )
        assert short < 2e-3
        np.testing.assert_allclose(np.array(out.tip_position), expected, atol=short)
        assert np.abs(np.array(out.tip_velocity)).max() < 1e-3


@pytest.mark.slow
def test_with_the_pedal_up_it_goes_where_the_robot_is_measured_if_told_so() -> None:
    with jax.enable_x64(True):
        # Jaws are asked for, not left.
        there = tuple(q + 0.01 * (i + 1) * (i < 5) for i, q in enumerate(HOME_JPOS))
        moving, lifted = [clean((30, 0, 0))] * 100, [clean(engaged=0)] * 2
        left, _ = run(SETUP, moving + lifted, measured=there)
        along, _ = run(SETUP, moving + lifted, measured=there, resync=1)
        assert np.abs(np.array(left.jpos) - np.array(there))[:5].min() > 1e-3
        np.testing.assert_allclose(np.array(along.jpos), there, atol=1e-9)
        np.testing.assert_allclose(np.array(along.target.jpos_d), there, atol=1e-9)
        on, _ = run(SETUP, moving + lifted + [clean()] * 500, measured=there, resync=1)
        # No jump at the next pedal-down.
        np.testing.assert_allclose(np.array(on.jpos)[:5], there[:5], atol=1e-4)
        # Openings are whole mrad.
        np.testing.assert_allclose(np.array(on.jpos)[5:], there[5:], atol=1e-3)


def test_the_pedal_up_holds_and_reanchors() -> None:
    with jax.enable_x64(True):
        moving = [clean((30, 0, 0))] * 100
        state, _ = run(SETUP, moving)
        held, out = run(SETUP, moving + [clean((500, 500, 500), engaged=0)] * 50)
        np.testing.assert_array_equal(np.array(held.jpos), np.array(state.jpos))
        assert (
            np.abs(np.array(held.jvel)).max() == 0.0
            and np.abs(np.array(out.tip_velocity)).max() == 0.0
        )
        np.testing.assert_allclose(
            np.array(held.target.position_um) * 1e-6, np.array(out.tip_position), atol=1.1e-6
        )


def test_targets_stop_at_the_soft_limits_and_the_console_slips() -> None:
    with jax.enable_x64(True):
        start = HOME_JPOS.replace(2, 0.555)
        away = (
            kinematics.forward_pose("gold", start).position,
            kinematics.forward_pose("gold", start.replace(2, 0.556)).position,
        )
        direction = np.array(away[1]) - np.array(away[0])
        x, y, z = direction / np.linalg.norm(direction)
        step_um = np.round(60 * np.array([-y, z, -x])).astype(int)  # ITP axes of that direction
        state, _ = run(SETUP, [clean(step_um)] * 400, start)
        assert float(state.target.jpos_d[2]) <= 0.56 + 1e-9 and float(state.jpos[2]) < 0.5605
        back, _ = run(SETUP, [clean(step_um)] * 400 + [clean(-step_um)] * 100, start)
        # 6 mm back from the limit, not from 24 mm beyond it.
        assert float(back.target.jpos_d[2]) < 0.5555


def test_an_unreachable_absolute_target_is_held_off() -> None:
    one = RavenSetup(precision=REFERENCE, console="absolute", software="fork2015")
    with jax.enable_x64(True):
        state, _ = run(one, [clean((0, 0, 0), (0.0, 0.0, 0.0, 1.0), 1570, setup=one)] * 20)
        np.testing.assert_array_equal(np.array(state.target.jpos_d), np.array(HOME_JPOS, float))
