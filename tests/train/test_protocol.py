"""The scene in plain numbers agrees with the robot's own, and with the jaws that are drawn."""

import numpy as np
import pytest
from made_frames import from_world

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import mapping, scene
from ravenjax.robots.raven2.geometry.arrays import jaw_rotation
from ravenjax.train import protocol

pytestmark = pytest.mark.parametrize("arm", ["gold", "green"])


def test_points_and_ways_as_scene_and_mapping_have_them(arm):
    point = (-0.07, -0.02, 0.015)
    np.testing.assert_allclose(
        protocol.to_world(arm, point), scene.to_world(arm, Vec(point)), rtol=1e-12
    )
    np.testing.assert_allclose(from_world(arm, protocol.to_world(arm, point)), point, atol=1e-15)
    for axis in range(3):
        way = np.eye(3)[axis]
        in_frame0 = mapping.position_from_itp(
            arm, Vec(protocol.turn_vector(protocol.itp_from_view(arm), tuple(way)))
        )
        in_world = np.array(scene.frame0_in_world(arm)[1]) @ np.array(in_frame0)
        np.testing.assert_allclose(in_world, protocol.VIEW[axis], atol=1e-12)
        np.testing.assert_allclose(
            protocol.turn_vector(protocol.VIEW, tuple(in_world)), way, atol=1e-12
        )


def test_the_surface_is_where_the_depth_is_zero(arm):
    for x, y in ((0.0, 0.0), (0.03, -0.02), (-0.05, 0.05)):
        at = from_world(arm, (x, y, protocol.tissue_height(x, y) - 0.002))
        assert float(scene.tissue_depth(arm, Vec(at))) == pytest.approx(0.002, abs=1e-6)


def test_closed_jaws_point_where_the_kinematics_has_them(arm):
    for jpos in np.random.default_rng(1).uniform(-2.0, 2.0, (50, 7)):
        np.testing.assert_allclose(
            protocol.jaw_direction(arm, jpos.tolist()), jaw_rotation(arm, jpos)[:, 0], atol=1e-12
        )
