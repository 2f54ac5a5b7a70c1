"""Where the arms stand in the operating scene."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ravenjax.robots.raven2.arms import ARMS
from ravenjax.robots.raven2.dynamics import arm_model
from ravenjax.robots.raven2.geometry import scene


@pytest.mark.parametrize("arm", ARMS)
def test_an_arms_frame_is_that_of_the_model(arm):
    body = arm_model.operating_scene().body(arm_model.base_body(arm))
    origin, rows = scene.frame0_in_world(arm)
    assert list(origin) == body.pos.tolist()
    np.testing.assert_allclose(
        np.array(rows), Rotation.from_quat(body.quat, scalar_first=True).as_matrix(), atol=1e-12
    )
    assert all(type(x) is float for row in rows for x in row)
