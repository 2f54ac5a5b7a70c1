"""The rigid motion between two sets of points."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from studies.healthy_robot import rigid


def test_a_rigid_motion_is_found_again_for_each_of_many_sets() -> None:
    rng = np.random.default_rng(0)
    points = rng.normal(size=(50, 3)) * 0.05
    turns = Rotation.random(4, random_state=1).as_matrix()
    moves = rng.normal(size=(4, 3)) * 0.01
    motion = rigid.fit(points, points @ np.swapaxes(turns, -1, -2) + moves[:, None, :])
    np.testing.assert_allclose(motion.rotation, turns, atol=1e-12)
    np.testing.assert_allclose(motion.translation, moves, atol=1e-12)


def test_a_mirror_image_is_met_by_a_rotation() -> None:
    points = np.random.default_rng(1).normal(size=(50, 3))
    assert np.linalg.det(rigid.fit(points, points * (1.0, 1.0, -1.0)).rotation) == pytest.approx(
        1.0
    )
