"""Poses cut to what the control software stores."""

from __future__ import annotations

import jax
import numpy as np

from ravenjax.numbers.setup import ORIGINAL
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import stored_pose
from ravenjax.robots.raven2.geometry.joints import Pose
from ravenjax.robots.raven2.setup import RavenSetup

SETUP = RavenSetup(precision=ORIGINAL)


def test_micrometres_are_cut_toward_zero_and_rotations_rounded():
    with jax.enable_x64(True):
        rows = Vec(Vec((0.1, 0.2, 0.3)) for _ in range(3))
        pose = stored_pose.store(SETUP, Pose(Vec((1.9999e-6, -1.9999e-6, 5e3)), rows), 7)
        assert [int(x) for x in pose.position_um] == [1, -1, -(2**31)]
        assert float(pose.rotation[0][0]) == float(np.float32(0.1))
        back = stored_pose.load(SETUP, pose)
        assert float(back.position[0]) == 1 / 1e6
        assert float(back.rotation[0][0]) == float(np.float32(0.1))
