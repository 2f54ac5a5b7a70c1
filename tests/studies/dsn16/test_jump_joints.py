"""Which joints make a jump: on joints that are made up, beside the Jacobian, and what is said of
them.
"""

from __future__ import annotations

import jax
import numpy as np
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from studies.dsn16 import detector

POSE = np.array(HOME_JPOS, float) + 0.8 * np.eye(7)[4]
"""With a bent wrist: with a straight one the roll leaves the tip where it is."""
STEP = {
    "shoulder": (0, 0.01),
    "elbow": (1, 0.01),
    "insertion": (2, 0.001),
    "roll": (3, 0.05),
    "wrist": (4, 0.05),
}


def moving(**steps: float) -> np.ndarray:
    """Joints [3, 7] that go on by so many of STEP from packet to packet."""
    way = np.zeros(7)
    for name, times in steps.items():
        joint, size = STEP[name]
        way[joint] = times * size
    return POSE + np.arange(3)[:, None] * way


@pytest.mark.parametrize(
    ("name", "kind"), [("shoulder", 0), ("elbow", 0), ("insertion", 0), ("roll", 1), ("wrist", 1)]
)
def test_a_joint_that_moves_alone_makes_the_whole_jump(name, kind):
    result = detector.attribute(moving(**{name: 1.0})[None], 0.1)
    expected = np.eye(5)[STEP[name][0]]
    np.testing.assert_allclose(result.shares[0], expected, atol=1e-9)
    assert [bool(one[0]) for one in result.kinds] == [k == kind for k in range(4)]


def test_small_steps_of_several_joints_add_up_as_the_jacobian_says():
    joints = moving(shoulder=0.03, insertion=0.2, wrist=0.05)
    with jax.enable_x64(True):
        rows = kinematics.tip_jacobian("gold", Vec(joints[0]))
    jacobian = np.array([[float(x) for x in rows[i]][:5] for i in range(3)])
    way = joints[1, :5] - joints[0, :5]
    step = jacobian @ way
    expected = (jacobian * way).T @ step / (step @ step)
    result = detector.attribute(joints[None], 0.01)
    np.testing.assert_allclose(result.shares[0], expected, atol=0.02)
    assert result.shares[0].sum() == pytest.approx(1.0, abs=0.01)
