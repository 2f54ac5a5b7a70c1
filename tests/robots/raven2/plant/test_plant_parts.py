"""Parts of the virtual robot by themselves: coupling matrix, cable law, dry friction, brakes,
stops.
"""

from __future__ import annotations

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import brakes, cables, stops
from ravenjax.robots.raven2.plant.coupling import coupling
from ravenjax.robots.raven2.plant.friction import coulomb_damping
from ravenjax.robots.raven2.setup import RavenSetup

ARMS, TOOLS = ("gold", "green"), ("r_grasper", "large_needle", "r_sq_grasper")
CASES = list(itertools.product(ARMS, TOOLS, ("raven2", "fork2015")))


@pytest.mark.parametrize(("arm", "tool", "software"), CASES)
def test_the_split_coupling_is_the_motor_matrix(arm, tool, software) -> None:
    matrix = np.array(transmission.motor_matrix(arm, tool, software))
    split = coupling(arm, tool, software)
    rng = np.random.default_rng(1)
    x, weights = rng.normal(size=7), rng.uniform(0.1, 2.0, 7)
    np.testing.assert_allclose(split.motors(Vec(x)), matrix @ x, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(
        split.joints(Vec(x)), np.linalg.solve(matrix, x), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(split.loads(Vec(x)), matrix.T @ x, rtol=1e-12, atol=1e-9)
    expected = matrix.T @ np.diag(weights) @ matrix
    np.testing.assert_allclose(
        np.tril(split.congruence(Vec(weights))), np.tril(expected), rtol=1e-9, atol=1e-9
    )


def test_the_cable_law_is_the_exponential_one() -> None:
    stiffness, damping, arm = 720e3, 4000.0, cables.POSITIONING_ARM
    with jax.enable_x64(True):
        for delta in (-5e-4, 1e-9, 3e-3, 0.05):
            expected = stiffness * (np.exp(delta) - np.exp(-delta)) + 2 * damping * 0.3
            np.testing.assert_allclose(
                cables.tension(stiffness, damping, delta, 0.3), expected, rtol=1e-7
            )
            resting = arm * stiffness * (np.exp(delta) - np.exp(-delta))
            found = cables.resting_stretch(arm, stiffness, jnp.float64(resting))
            np.testing.assert_allclose(found, delta / arm, rtol=1e-5)

        # implicit damping = damping plus the spring's slope over the step
        linear, dt, bit = cables.linearise(arm, stiffness, damping, 0.4, 1e-3), 1e-3, 1e-6
        further = cables.linearise(arm, stiffness, damping, 0.4 + bit, 1e-3)
        slope = (further.force - linear.force) / bit
        np.testing.assert_allclose(linear.damping, dt * slope + 2 * damping * arm**2, rtol=1e-6)


def test_small_stretches_keep_their_digits_in_float32() -> None:
    delta = 1e-6
    found = cables.tension(jnp.float32(720e3), jnp.float32(0.0), jnp.float32(delta), 0.0)
    np.testing.assert_allclose(found, 2 * 720e3 * delta, rtol=1e-6)
    assert (
        abs(np.float32(720e3) * (np.exp(np.float32(delta)) - np.exp(np.float32(-delta))) / 1.44 - 1)
        > 0.01
    )


def test_dry_friction_holds_up_to_its_level_and_slides_at_it() -> None:
    with jax.enable_x64(True):
        level, inertia = 0.5, 200.0
        for drive in (-3.0, -0.51, 0.7, 40.0):
            damping = float(coulomb_damping(level, drive, inertia))
            speed = drive / (inertia + damping)
            np.testing.assert_allclose(damping * speed, level * np.sign(drive), rtol=1e-9)
        for drive in (-0.5, 0.0, 0.3):
            speed = drive / (inertia + float(coulomb_damping(level, drive, inertia)))
            assert abs(speed) <= 1e-7
        assert float(coulomb_damping(0.0, 1.0, inertia)) == 0.0


def test_brakes_follow_their_command_after_a_delay_and_ignore_glitches() -> None:
    setup = RavenSetup()
    params = brakes.params(setup)
    state, grips = brakes.init(setup, params), []
    commands = [0] * 40 + [1] * 5 + [0] * 20 + [1] * 30
    for command in commands:
        state, holding = brakes.step(setup, params, state, jnp.int32(command))
        grips.append(float(holding) > 0)
    changes = [tick for tick in range(1, len(grips)) if grips[tick] != grips[tick - 1]]
    assert changes == [20, 65 + 15]
    np.testing.assert_allclose(float(holding), 4.9)


def test_a_stop_pushes_back_only_beyond_the_range() -> None:
    params = stops.params("r_grasper")
    for joint, (low, high) in enumerate(zip(params.lower, params.upper, strict=True)):
        inside = stops.contact(params, joint, jnp.float32(0.5 * (low + high)), 1.0, 1e-3)
        above = stops.contact(params, joint, jnp.float32(high + 1e-3), 0.0, 1e-3)
        below = stops.contact(params, joint, jnp.float32(low - 1e-3), 0.0, 1e-3)
        assert float(inside.force) == 0.0 and float(inside.damping) == 0.0
        assert float(above.force) < 0.0 < float(below.force) and float(above.damping) > 0.0
