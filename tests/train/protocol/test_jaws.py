"""The point where jaws close: that of the software's kinematics, and of the jaws that are drawn."""

import numpy as np
import pytest

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import instrument, kinematics
from ravenjax.robots.raven2.geometry.arrays import jaw_rotation
from ravenjax.train import protocol


@pytest.mark.parametrize("arm", ["gold", "green"])
def test_closed_jaws_point_where_the_kinematics_has_them(arm):
    for jpos in np.random.default_rng(1).uniform(-2.0, 2.0, (50, 7)):
        np.testing.assert_allclose(
            protocol.jaw_direction(arm, jpos.tolist()), jaw_rotation(arm, jpos)[:, 0], atol=1e-12
        )


@pytest.mark.parametrize("arm", ["gold", "green"])
def test_each_jaw_ends_where_contact_has_its_tip(arm):
    for jpos in np.random.default_rng(2).uniform(-1.0, 1.0, (5, 7)):
        tips = instrument.jaw_tips(arm, Vec(jpos.tolist()))
        axis = kinematics.forward_pose(arm, Vec(jpos.tolist())).position
        closing = protocol.closing_point(arm, [float(x) for x in axis], jpos.tolist())
        found = protocol.jaw_tips(arm, closing, jpos.tolist())
        expected = [[float(x) for x in tip.at] for tip in tips]
        np.testing.assert_allclose(found, expected, atol=1e-6)  # single precision
