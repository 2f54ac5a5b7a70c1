"""The jaws' rotation in NumPy, beside the robot's own kinematics; names and geometry without
jax.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from ravenjax.robots.raven2.geometry import arrays, links


@pytest.mark.parametrize("arm", ["gold", "green"])
def test_the_rotation_is_that_of_the_forward_kinematics(arm):
    random = np.random.default_rng(4)
    jpos = random.uniform(-1, 1, (3, 20, 7)) * [1.5, 1.5, 0.3, 3, 1.4, 1, 1]
    _, wanted = arrays.forward_kinematics(jpos, arm)
    np.testing.assert_allclose(links.jaw_rotation(arm, jpos), wanted, atol=1e-12)
    np.testing.assert_allclose(links.jaw_rotation(arm, jpos[0, 0]), wanted[0, 0], atol=1e-12)


def test_a_joint_that_is_no_number_gives_a_rotation_that_is_none():
    jpos = np.zeros((2, 7))
    jpos[1, 3] = np.nan
    found = links.jaw_rotation("gold", jpos)
    assert np.isfinite(found[0]).all() and np.isnan(found[1]).any()


def test_readers_of_results_need_no_jax():
    code = "import sys, ravenjax.robots.raven2.geometry.links; sys.exit('jax' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
