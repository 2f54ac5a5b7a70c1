"""Debian's `rosbag play` plays a bag written here: a node that subscribes hears every message."""

import json
import os
import socket
import subprocess
from pathlib import Path

import pytest
from test_bag_writing import DEBIANS_PYTHON, session  # noqa: F401 - a fixture

from ravenjax.store.logs import bags

MASTER, PLAY, ROSPY = (
    Path("/usr/bin/rosmaster"),
    Path("/usr/bin/rosbag"),
    Path("/usr/lib/python3/dist-packages/rospy"),
)
HEAR = """
import json, sys, time, rospy
counts = {}
def heard(message, topic):
    counts[topic] = counts.get(topic, 0) + 1
rospy.init_node("hear", disable_signals=True)
for topic in sys.argv[2:]:
    rospy.Subscriber(topic, rospy.AnyMsg, heard, callback_args=topic, queue_size=1000)
print("ready", flush=True)
end = time.monotonic() + 60
while sum(counts.values()) < int(sys.argv[1]) and time.monotonic() < end:
    time.sleep(0.05)
time.sleep(0.5)
print(json.dumps(counts))
"""


@pytest.mark.slow  # a ROS master, a player that waits for its subscribers, and a node
@pytest.mark.skipif(
    not all(one.exists() for one in (MASTER, PLAY, ROSPY)), reason="Debian's ROS 1 is not installed"
)
def test_rosbag_plays_every_message(session, tmp_path):  # noqa: F811
    written = bags.write_bag(session, 1, tmp_path / "session.bag")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    environ = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environ |= {
        "ROS_MASTER_URI": f"http://127.0.0.1:{port}",
        "ROS_IP": "127.0.0.1",
        "HOME": str(tmp_path),
    }
    master = subprocess.Popen(
        [MASTER, "--core", "-p", str(port)], env=environ, stdout=subprocess.DEVNULL
    )
    topics = [
        f"/arm1/{name}"
        for name in ("measured_cp", "measured_js", "model_cp", "setpoint_js", "haptic_cf")
    ]
    told = {"/ravenjax/events": 1, "/ravenjax/signals": 50} | dict.fromkeys(topics, 5)
    hear = subprocess.Popen(
        [DEBIANS_PYTHON, "-c", HEAR, str(sum(told.values())), *told],
        env=environ,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert hear.stdout is not None and "ready\n" in hear.stdout, (
            "rospy may complain of a slow master before"
        )
        # it advertises its topics, waits, then sends
        subprocess.run(
            [PLAY, "play", "--delay=5", "-q", written.path], env=environ, check=True, timeout=60
        )
        counts = json.loads(hear.communicate(timeout=70)[0])
    finally:
        hear.kill()
        master.terminate()
        master.wait()
    assert counts == told
