"""Bags as recorded motions; those of Debian's rosbag are written by the system's own Python."""

from __future__ import annotations

import subprocess

import numpy as np
import pytest

from ravenjax.errors import UserError
from ravenjax.store.motion import bag_file, recording
from ravenjax.store.motion.options import ReplayOptions

PYTHON = "/usr/bin/python3"
WRITER = """
import math, sys
import rosbag
from genpy import Time
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
with rosbag.Bag(sys.argv[1], "w", compression=sys.argv[2]) as bag:
    for k in range(100):
        stamp = Time(1700000000, 10_000_000 * k)
        tip = PoseStamped()
        tip.header.stamp = stamp
        tip.pose.position.x, tip.pose.position.y, tip.pose.position.z = 0.01, -0.02 + 1e-4 * k, 0.03
        tip.pose.orientation.z, tip.pose.orientation.w = math.sin(0.001 * k), math.cos(0.001 * k)
        bag.write("/arm1/setpoint_cp", tip, stamp)
        jaws = JointState(name=["grasp1", "grasp2"], position=[0.2, 0.001 * k])
        jaws.header.stamp = stamp
        bag.write("/arm1/setpoint_js", jaws, stamp)
"""


@pytest.mark.parametrize("compression", ["none", "bz2"])
def test_a_bag_of_debians_rosbag_is_a_motion(tmp_path, compression):
    if subprocess.run(
        [PYTHON, "-c", "import rosbag, geometry_msgs, sensor_msgs"], capture_output=True
    ).returncode:
        pytest.skip(
            "Debian's python3-rosbag, python3-geometry-msgs and python3-sensor-msgs are absent"
        )
    path = tmp_path / "hands.bag"
    environment = {"PATH": "/usr/bin:/bin"}
    subprocess.run([PYTHON, "-c", WRITER, str(path), compression], check=True, env=environment)
    assert recording.arms_in(path) == ("gold",)
    one = recording.load(path, ("gold",), ReplayOptions())
    samples, k = one.track.arms["gold"], np.arange(100)
    assert one.track.clock == "header stamps of /arm1/setpoint_cp"
    np.testing.assert_allclose(samples.time_s, 0.01 * k, atol=1e-8)
    np.testing.assert_allclose(
        samples.position, np.stack([0.01 + 0 * k, -0.02 + 1e-4 * k, 0.03 + 0 * k], axis=1)
    )
    np.testing.assert_allclose(samples.quat[:, 2], np.sin(0.001 * k), atol=1e-12)
    np.testing.assert_allclose(samples.opening_mrad, 200.0 + k)
    assert len(one) == 991
    with pytest.raises(UserError, match="no topic /arm2/setpoint_cp or /arm2/measured_cp"):
        bag_file.read_track(path, ("green",), None)
