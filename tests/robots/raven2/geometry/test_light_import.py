"""Readers of results compute with the robot's geometry, and need no jax."""

import subprocess
import sys


def test_readers_of_results_need_no_jax():
    code = (
        "import sys; from ravenjax.robots.raven2.geometry import arrays;"
        " arrays.jaw_rotation('gold', [0.0] * 7); sys.exit('jax' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
