"""Where the software wants the tip is the robot's own forward kinematics."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.trainer.page.aim import Aim


@pytest.mark.parametrize("arm", ARMS)
def test_the_aim_is_the_forward_kinematics(arm):
    for jpos in np.random.default_rng(3).uniform([0.2, 1, 0.3, -1, -1, 0, 0], [1.2, 2, 0.5, 1, 1, 1, 1], (4, 7)):
        wanted = kinematics.forward(arm, Vec(jpos.tolist())).position
        np.testing.assert_allclose(Aim(arm).tip(jpos), np.array([float(x) for x in wanted]), atol=1e-7)
