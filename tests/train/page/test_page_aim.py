"""Where the software wants the tip is the robot's own forward kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.instrument import JAW_LENGTH
from ravenjax.train.page.process import Aim


@pytest.mark.parametrize("arm", ARMS)
def test_the_aim_is_the_forward_kinematics(arm):
    for jpos in np.random.default_rng(3).uniform(
        [0.2, 1, 0.3, -1, -1, 0, 0], [1.2, 2, 0.5, 1, 1, 1, 1], (4, 7)
    ):
        pose = kinematics.forward(arm, Vec(jpos.tolist()))
        wanted = [
            float(x) + JAW_LENGTH * float(row[0])
            for x, row in zip(pose.position, pose.rotation, strict=True)
        ]
        np.testing.assert_allclose(Aim(arm).tip(jpos), wanted, atol=1e-7)
