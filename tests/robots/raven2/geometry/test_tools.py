import numpy as np
import pytest

from ravenjax.robots.raven2.geometry.limits import HOME_JPOS, soft_limits
from ravenjax.robots.raven2.geometry.tools import TOOLS

DEG = np.pi / 180


@pytest.mark.parametrize("tool", TOOLS.values(), ids=TOOLS.keys())
def test_soft_limits_lie_inside_the_hard_stops(tool):
    limits = np.radians(tool.limit_deg)
    assert (limits < tool.hard_max).all() and (-limits > np.array(tool.hard_min)).all()
    assert tool.wrist_coupling == 0 or tool.style == "dv"


def test_soft_limits():
    present, fork = soft_limits("r_grasper"), soft_limits("r_grasper_B", "fork2015")
    np.testing.assert_allclose(
        present.lower, [0, 45 * DEG, 0.23, -182 * DEG, -70 * DEG, -105 * DEG]
    )
    np.testing.assert_allclose(present.upper[:5], [90 * DEG, 135 * DEG, 0.56, 182 * DEG, 70 * DEG])
    assert present.upper[5] is fork.lower[5] is fork.upper[5] is None
    assert (fork.lower[3], fork.upper[3]) == pytest.approx((-150 * DEG, 150 * DEG))
    assert all(
        low < home < high
        for low, home, high in zip(present.lower[:5], HOME_JPOS, present.upper[:5], strict=False)
    )
