"""Parts of the virtual robot by themselves: coupling matrix, cable law, dry friction, brakes,
stops.
"""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import drives
from ravenjax.robots.raven2.plant.coupling import arm_coupling

ARMS, TOOLS = ("gold", "green"), ("r_grasper", "large_needle", "r_sq_grasper")
CASES = list(itertools.product(ARMS, TOOLS, ("raven2", "fork2015")))


@pytest.mark.parametrize(("arm", "tool", "software"), CASES)
def test_the_split_coupling_is_the_motor_matrix(arm, tool, software) -> None:
    matrix = np.array(transmission.motor_matrix(arm, tool, software))
    split = arm_coupling(arm, tool, software)
    rng = np.random.default_rng(1)
    x, weights = rng.normal(size=7), rng.uniform(0.1, 2.0, 7)
    np.testing.assert_allclose(split.to_motors(Vec(x)), matrix @ x, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(
        split.to_joints(Vec(x)), np.linalg.solve(matrix, x), rtol=1e-9, atol=1e-12
    )
    np.testing.assert_allclose(split.joint_loads(Vec(x)), matrix.T @ x, rtol=1e-12, atol=1e-9)
    expected = matrix.T @ np.diag(weights) @ matrix
    np.testing.assert_allclose(
        np.tril(split.congruence(Vec(weights))), np.tril(expected), rtol=1e-9, atol=1e-9
    )


def test_the_cable_law_is_the_exponential_one() -> None:
    stiffness, damping, arm = 720e3, 4000.0, transmission.CABLE_PER_MOTOR[0]
    with jax.enable_x64(True):
        for delta in (-5e-4, 1e-9, 3e-3, 0.05):
            expected = stiffness * (np.exp(delta) - np.exp(-delta)) + 2 * damping * 0.3
            np.testing.assert_allclose(
                drives.cable_tension(stiffness, damping, delta, 0.3), expected, rtol=1e-7
            )
            resting = arm * stiffness * (np.exp(delta) - np.exp(-delta))
            found = drives.resting_stretch(arm, stiffness, jnp.float64(resting))
            np.testing.assert_allclose(found, delta / arm, rtol=1e-5)

        # implicit damping = damping plus the spring's slope over the step
        linear, dt, bit = drives.linearise_cable(arm, stiffness, damping, 0.4, 1e-3), 1e-3, 1e-6
        further = drives.linearise_cable(arm, stiffness, damping, 0.4 + bit, 1e-3)
        slope = (further.force - linear.force) / bit
        np.testing.assert_allclose(linear.damping, dt * slope + 2 * damping * arm**2, rtol=1e-6)


def test_dry_friction_holds_up_to_its_level_and_slides_at_it() -> None:
    with jax.enable_x64(True):
        level, inertia = 0.5, 200.0
        for drive in (-3.0, -0.51, 0.7, 40.0):
            damping = float(drives.coulomb_damping(level, drive, inertia))
            speed = drive / (inertia + damping)
            np.testing.assert_allclose(damping * speed, level * np.sign(drive), rtol=1e-9)
        for drive in (-0.5, 0.0, 0.3):
            speed = drive / (inertia + float(drives.coulomb_damping(level, drive, inertia)))
            assert abs(speed) <= 1e-7
        assert float(drives.coulomb_damping(0.0, 1.0, inertia)) == 0.0


def test_brakes_follow_their_command_after_a_delay_and_ignore_glitches() -> None:
    params = drives.BrakeParams()
    state, grips = drives.BrakeState(jnp.int32(1), jnp.int32(0)), []
    commands = [0] * 40 + [1] * 5 + [0] * 20 + [1] * 30
    for command in commands:
        state, holding = drives.step_brakes(params, state, jnp.int32(command))
        grips.append(float(holding) > 0)
    changes = [tick for tick in range(1, len(grips)) if grips[tick] != grips[tick - 1]]
    assert changes == [20, 65 + 15]
    np.testing.assert_allclose(float(holding), 4.9)
