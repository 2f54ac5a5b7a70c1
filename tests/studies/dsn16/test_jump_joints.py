"""Which joints make a jump, on joints that are made up."""

import numpy as np
import pytest

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
    none = np.full((3, 7), np.nan)
    found = detector.attribute(np.stack([moving(**{name: 1.0}), none]), 0.1)
    assert found.tolist() == [[k == kind for k in range(4)], [False] * 4]
