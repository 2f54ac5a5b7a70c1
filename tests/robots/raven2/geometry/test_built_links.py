"""The tip of an arm with links of its own, beside the software's kinematics and a chain of 4 x 4
matrices.
"""

import math

import jax
import numpy as np
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import built_links, kinematics
from ravenjax.robots.raven2.geometry.built_links import LinkErrors

LOW, HIGH = (0.0, 0.8, 0.23, -3.0, -1.2, -1.0, -1.0), (1.6, 2.3, 0.56, 3.0, 1.2, 1.0, 1.0)
# In deg: theta of the table at joint 0.
ZEROS = {"gold": (205.0, 180.0, 90.0), "green": (25.0, 0.0, -90.0)}


def by_matrices(arm: str, q: np.ndarray, errors: LinkErrors) -> np.ndarray:
    """Rows (alpha, a, theta, d) of the modified DH table, multiplied out."""
    zero1, zero2, theta3 = map(math.radians, ZEROS[arm])
    twist1 = math.radians(75.0) + errors.twist12
    twist2 = math.radians(52.0) + errors.twist23
    right = math.pi / 2.0
    rows = (
        (0.0 if arm == "gold" else math.pi, 0.0, q[0] + zero1, 0.0),
        (twist1, errors.length12, q[1] + zero2, 0.0),
        (math.pi - twist2 if arm == "gold" else twist2, errors.length23, theta3, q[2]),
        (0.0, errors.length34, q[3], -0.47 - errors.tool_length),
        (right, 0.0, q[4] - right, 0.0),
        (right, 0.013 + errors.wrist_length, 0.0, 0.0),
    )
    chain = np.eye(4)
    for alpha, a, theta, d in rows:
        ca, sa, ct, st = math.cos(alpha), math.sin(alpha), math.cos(theta), math.sin(theta)
        about_x = np.array([[1, 0, 0, a], [0, ca, -sa, 0], [0, sa, ca, 0], [0, 0, 0, 1]])
        chain = (
            chain
            @ about_x
            @ np.array([[ct, -st, 0, 0], [st, ct, 0, 0], [0, 0, 1, d], [0, 0, 0, 1]])
        )
    return chain[:3, 3]


@pytest.mark.parametrize("arm", ["gold", "green"])
def test_the_tip_is_that_of_the_multiplied_matrices(arm) -> None:
    rng = np.random.default_rng(1)
    with jax.enable_x64(True):
        for q in rng.uniform(LOW, HIGH, (10, 7)):
            size = rng.uniform(-1.0, 1.0, 7) * (0.1, 0.1, 0.01, 0.01, 0.01, 0.01, 0.005)
            errors = LinkErrors(*map(float, size))
            tip = np.array(built_links.jaw_axis_position(arm, Vec(q), errors))
            np.testing.assert_allclose(tip, by_matrices(arm, q, errors), atol=1e-14)


@pytest.mark.parametrize("arm", ["gold", "green"])
def test_links_as_drawn_have_the_software_s_tip(arm) -> None:
    with jax.enable_x64(True):
        for q in np.random.default_rng(2).uniform(LOW, HIGH, (10, 7)):
            tip = np.array(
                built_links.jaw_axis_position(arm, Vec(q), built_links.LinkErrors(*(0.0,) * 7))
            )
            np.testing.assert_allclose(
                tip, np.array(kinematics.forward_pose(arm, Vec(q)).position), atol=1e-14
            )
