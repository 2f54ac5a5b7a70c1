import jax
import numpy as np
import oracle_kinematics as oracle
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.geometry import gravity


def height_energy(arm: str, jpos: np.ndarray) -> float:
    """Potential energy (J) of the three links along +x0, from the chain's own matrices."""
    number = ARMS.index(arm)
    links = oracle.links(number, oracle.joint_to_theta(number, [*jpos[:5], 0.0]))
    heights = [
        oracle.apply(oracle.chain(links[: k + 1]), centre)[0]
        for k, centre in enumerate((*gravity.CENTRES[arm], (0.0, 0.0, 0.0)))
    ]
    return float(np.dot(gravity.MASSES, heights) * gravity.GRAVITY)


@pytest.mark.parametrize("arm", ARMS)
def test_is_the_gradient_of_potential_energy(arm):
    """What holds the links is the derivative of their energy by each joint."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        jpos = rng.uniform([0, 0.8, 0.25, 0, 0, 0, 0], [1.5, 2.3, 0.55, 1, 1, 1, 1])
        step = 1e-5 * np.eye(7)[:3]
        slope = [(height_energy(arm, jpos + s) - height_energy(arm, jpos - s)) / 2e-5 for s in step]
        with jax.enable_x64(True):
            np.testing.assert_allclose(
                gravity.joint_gravity_torque(arm, Vec(jpos)), slope, atol=1e-9
            )
