"""Readers of results compute with the robot's geometry, and need no jax."""

from __future__ import annotations

import subprocess
import sys

import numpy as np

from ravenjax.robots.raven2.geometry import arrays


def test_a_joint_that_is_no_number_gives_a_rotation_that_is_none():
    jpos = np.zeros((2, 7))
    jpos[1, 3] = np.nan
    found = arrays.jaw_rotation("gold", jpos)
    np.testing.assert_array_equal(found[0], arrays.forward_kinematics(jpos[0], "gold")[1])
    assert np.isnan(found[1]).any()


def test_readers_of_results_need_no_jax():
    code = (
        "import sys; from ravenjax.robots.raven2.geometry import arrays;"
        " arrays.jaw_rotation('gold', [0.0] * 7); sys.exit('jax' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
