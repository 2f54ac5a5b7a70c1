"""A program that knows CRTK's conventions alone reads, drives, clutches and stops a robot, over
each transport.

The peers run as processes of their own (`dds_peer.py`, `ros1_peer.py`), with definitions of their
own.
"""

import contextlib
import importlib.util
import json
import os
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import uuid
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import waiting

from ravenjax.store.logs.session import log as session_log

HERE = Path(__file__).parent
ROSPY = Path("/usr/lib/python3/dist-packages/rospy")
pytestmark = pytest.mark.slow


class Network(NamedTuple):
    """One ROS that nobody else hears."""

    ros: str
    environ: dict[str, str]


@contextlib.contextmanager
def network(ros):
    """DDS participants that share a tag on this machine alone, or a ROS master at a port of its
    own.
    """
    if ros == "ros2":
        discovery = (
            f"<Discovery><Tag>{uuid.uuid4().hex}</Tag><ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>30</MaxAutoParticipantIndex><Peers><Peer"
            " address='127.0.0.1'/></Peers></Discovery>"
        )
        general = (
            "<General><Interfaces><NetworkInterface address='127.0.0.1'/></Interfaces>"
            "<AllowMulticast>false</AllowMulticast></General>"
        )
        dds = f"<CycloneDDS><Domain>{general}{discovery}</Domain></CycloneDDS>"
        yield Network(ros, os.environ | {"ROS_DOMAIN_ID": "78", "CYCLONEDDS_URI": dds})
        return
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    environ = os.environ | {"ROS_MASTER_URI": f"http://127.0.0.1:{port}", "ROS_IP": "127.0.0.1"}
    foreign = {name: value for name, value in environ.items() if name != "PYTHONPATH"}
    command = ["/usr/bin/rosmaster", "--core", "-p", str(port)]
    master = subprocess.Popen(command, env=foreign, stdout=subprocess.DEVNULL)
    try:
        waiting.until(lambda: listens(port))
        yield Network(ros, environ)
    finally:
        master.terminate()
        master.wait()


def listens(port):
    with socket.socket() as trial:
        return trial.connect_ex(("127.0.0.1", port)) == 0


@pytest.fixture(scope="module", params=["ros2", "ros1"])
def ros(request):
    if request.param == "ros2" and importlib.util.find_spec("cyclonedds") is None:
        pytest.skip("the wheel cyclonedds is not installed")
    if request.param == "ros1" and not (ROSPY.is_dir() and Path("/usr/bin/rosmaster").exists()):
        pytest.skip("Debian's python3-rospy and python3-rosmaster are not installed")
    with network(request.param) as made:
        yield made


class LiveRobot:
    """`ravenjax robot --crtk`, or `ravenjax train`, as a process."""

    def __init__(self, network, *words):
        command = words or ("robot", "--itp-port", "0", "--joint-port", "0", "--crtk", network.ros)
        self.lines = []
        self._process = subprocess.Popen(
            [sys.executable, "-m", "ravenjax.cli", *command],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env=network.environ,
        )
        threading.Thread(target=self._listen, daemon=True).start()
        begins = ["realtime"] if words else ["CRTK", "console: ITP", "joint state"]
        here = lambda: all(any(li.startswith(b) for li in self.lines) for b in begins)  # noqa: E731
        waiting.until(lambda: here() or self._process.poll() is not None)
        assert here(), "".join(self.lines)
        self.itp_port, self.joint_port = self._port("console: ITP"), self._port("joint state")

    def _port(self, begin):
        line = next((line for line in self.lines if line.startswith(begin)), ":0")
        return int(line.rpartition(":")[2])

    def _listen(self):
        for line in self._process.stdout:
            self.lines.append(line)

    def close(self):
        if self._process.poll() is None:
            self._process.send_signal(signal.SIGINT)
        return self._process.wait(waiting.DEADLINE_S)


@pytest.fixture(scope="module")
def robot(ros):
    live = LiveRobot(ros)
    yield live
    live.close()


def peer(network, what):
    """The peer as a process, in the Python that has its transport."""
    dds = network.ros == "ros2"
    program = HERE / ("dds_peer.py" if dds else "ros1_peer.py")
    python = sys.executable if dds else "/usr/bin/python3"
    environ = {
        name: value for name, value in network.environ.items() if dds or name != "PYTHONPATH"
    }
    return subprocess.Popen(
        [python, str(program), what], stdout=subprocess.PIPE, text=True, env=environ
    )


@pytest.fixture(scope="module")
def answers(ros, robot):
    process = peer(ros, "all")
    text, _ = process.communicate(timeout=waiting.DEADLINE_S)
    assert process.returncode == 0
    return json.loads(text.splitlines()[-1])


def test_what_is_told_has_the_names_units_and_stamps_of_crtk(answers):
    told = answers["reading"]
    joints = "shoulder elbow insertion tool_roll wrist grasp1 grasp2"
    assert told["names"] == joints.split()
    assert told["frames"] == ["arm1_base", "arm1_base"] and told["velocities"] == 7
    assert 5 < told["rate"] < 101  # 100 where the machine is not busy
    assert 0 < told["age"] < 1.0
    # M, rad: no degrees, no mm.
    assert 0.2 < told["joints"][2] < 0.6 and 0.4 < told["joints"][0] < 0.7
    # home_pos and home_quat of raven2's params/raven_gold_crtk.yaml, where its joints stand within
    # some 0.1 rad
    assert told["position"] == pytest.approx([0.0239, -0.0144, -0.0779], abs=3e-3)
    dot = sum(a * b for a, b in zip(told["quat"], [-0.14, 0.636, 0.02, 0.76], strict=True))
    assert abs(dot) > 0.99
    assert told["state"] == "DISABLED" and told["homed"]


def test_what_is_commanded_is_done_in_the_axes_and_units_of_what_is_told(answers):
    for axis, (setpoint, off) in enumerate(answers["frame"]):
        expected = [0.004 if i == axis else 0.0 for i in range(3)]
        assert setpoint == pytest.approx(expected, abs=5e-6) and off < 1e-3
    relative = [0.04, 0, 0.005, 0, 0, 0, 0]
    assert answers["scale"]["relative"] == pytest.approx(relative, abs=2e-4)
    assert answers["scale"]["back"] == pytest.approx([0] * 7, abs=2e-4)
    move = answers["move"]
    assert move["busy"] and move["done"] and move["state"] == "ENABLED"
    assert 1.5 < move["seconds"] < 5.0  # 0.1 rad at a peak of 5 deg/s: 2.15 s
    assert move["off"] == pytest.approx([0] * 7, abs=3e-4)
    assert all(answers["feet"]) and answers["disable"] and answers["enable"]


@contextlib.contextmanager
def reports(robot):
    """A list that the robot's run levels are added to, tick by tick."""
    levels = []
    stream = socket.create_connection(("127.0.0.1", robot.joint_port))

    def listen():
        with contextlib.suppress(OSError):
            for line in stream.makefile("rb"):
                report = json.loads(line)
                levels.extend(report["channels"]["runlevel"] if "channels" in report else [])

    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    yield levels
    stream.shutdown(socket.SHUT_RDWR)
    listener.join()
    stream.close()


@pytest.mark.parametrize("end", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "frozen"])
def test_a_peer_that_stops_leaves_the_pedal_up(ros, robot, end):
    process = peer(ros, "hold")
    try:
        assert re.search("drives", process.stdout.readline())
        with reports(robot) as levels:
            waiting.until(lambda: levels[-1:] == [3])
            process.send_signal(end)
            stopped = time.monotonic()
            waiting.until(lambda: levels[-1:] == [2])
            assert time.monotonic() - stopped < 5.0  # sooner than what says nothing at all
    finally:
        process.kill()
        process.communicate()


def recorded(folder):
    """Events and columns of a session."""
    found = session_log.read_session_log(folder / session_log.FILE)
    return found.events, dict(zip(found.names, np.asarray(found.rows).T, strict=True))


SCENARIO = """
name = "over_ros"
duration_s = 600
"""


def test_a_session_is_driven_over_ros_and_recorded(ros, tmp_path):
    (tmp_path / "over_ros.toml").write_text(SCENARIO)
    folder = tmp_path / "session"
    file = str(tmp_path / "over_ros.toml")
    words = ["train", file, "--out", str(folder), "--no-page", "--crtk", ros.ros]
    with network(ros.ros) as apart:  # where no other robot has its names
        live = LiveRobot(apart, *words)
        process = peer(apart, "visit")
        try:
            text, _ = process.communicate(timeout=waiting.DEADLINE_S)
            assert "left" in text, "".join(live.lines)
        finally:
            process.kill()
            process.communicate()
            code = live.close()
    assert code == 0, "".join(live.lines)
    header = json.loads((folder / "session.json").read_text())
    assert header["consoles"] == ["page", "crtk"]
    events, _ = recorded(folder)
    assert next(event["console"] for event in events if event["kind"] == "owner") == "crtk"
    downs = [event["down"] for event in events if event["kind"] == "pedal"]
    down = downs.index(True)  # it is told to be up first
    assert downs[down : down + 2] == [True, False]


def test_a_session_hears_another_robot_over_ros(ros, robot, tmp_path):
    (tmp_path / "over_ros.toml").write_text(SCENARIO)
    folder = tmp_path / "session"
    address = f"127.0.0.1:{robot.itp_port}:{ros.ros}"
    words = ["--out", str(folder), "--no-page", "--robot", address, "--script", "none"]
    live = LiveRobot(ros, "train", str(tmp_path / "over_ros.toml"), *words)
    try:
        with reports(robot) as levels:
            waiting.until(lambda: levels.count(3) > 2000)
    finally:
        assert live.close() == 0, "".join(live.lines)
    _, rows = recorded(folder)
    followed = rows["gold/error_mm"][rows["runlevel"] == 3]
    assert len(followed) > 500, "".join(live.lines)
    assert np.median(followed) < 2.0  # of the reported tip from the nominal model here
    assert rows["gold/jpos/2"].max() < 0.6 and rows["gold/jpos/0"].min() > 0.2
