"""A robot elsewhere: against a stand-in in this process, then against `ravenjax robot` in a
process of its own.
"""

import json
import re
import signal
import socket
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
import waiting
from itp_client import Clock, datagram

from ravenjax.errors import UserError
from ravenjax.train import scenario
from ravenjax.train.protocol import STALE_MS, Frame, FrameLayout
from ravenjax.train.robot_link import process as robot_process
from ravenjax.train.robot_link.distant import DistantRobot
from ravenjax.train.robot_link.itp import increments_of
from ravenjax.train.robot_link.joint_stream import JointServer, RemoteRobot, encode_report
from ravenjax.train.session.advance import Session

GOLD = ("gold",)


class StandIn:
    """Both ports of a robot; its joint stream is polled by a thread, as another process would."""

    def __init__(self, greeting=None, token=None):
        self.udp = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.udp.bind(("127.0.0.1", 0))
        self.udp.settimeout(waiting.DEADLINE_S)
        self.joints = JointServer(
            greeting or {"robot": "ravenjax", "arms": ["gold"]}, "127.0.0.1", 0, token
        )
        self.frame = Frame(FrameLayout.of(GOLD))
        self.orders, self.tick = [], 0
        self._over = threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._poll)
        self._thread.start()

    @property
    def ports(self):
        return self.udp.getsockname()[1], self.joints.address[1]

    def _poll(self):
        while not self._over.wait(0.002):
            with self._lock:
                for order in self.joints.poll():
                    self.orders.append(order[1])
                    self.joints.answer(order)

    def publish(self):
        self.tick += 1
        with self._lock:
            self.joints.publish(encode_report(self.frame, self.tick, 0, {}))

    def close(self):
        self._over.set()
        self._thread.join()
        self.joints.close()
        self.udp.close()


@pytest.fixture
def robot():
    made = StandIn()
    yield made
    made.close()


@pytest.fixture
def session(robot, monkeypatch):
    monkeypatch.setattr(RemoteRobot, "clock", Clock())
    made = RemoteRobot("127.0.0.1", *robot.ports, arms=GOLD)
    yield made
    made.close()


def until(done, act=lambda: None):
    waiting.until(lambda: (act(), done())[1], every_s=0.005)


def test_packets_go_out_and_the_newest_report_comes_in_and_grows_old(robot, session):
    sent, clock = datagram(1, gold=(1, 2, 3)), session.clock
    assert session.exchange(sent) is None and session.stale
    assert robot.udp.recv(200) == sent
    for _ in range(3):
        robot.publish()
    until(lambda: session.report and session.report.tick == 3, lambda: session.exchange(sent))
    clock.ms += STALE_MS
    assert session.exchange(sent).tick == 3 and not session.stale, "it holds until the next"
    clock.ms += 1
    assert session.stale


def test_after_a_reset_only_reports_of_the_reset_robot_count(robot, session):
    robot.publish()
    until(lambda: session.report is not None, lambda: session.exchange(b""))
    with robot._lock:  # the order waits while two more of the old reports come
        session.order({"order": "reset"})
        for tick in (2, 3):
            robot.joints.publish(encode_report(robot.frame, tick, 0, {}))
        assert session.report is None
    until(lambda: robot.orders, lambda: session.exchange(b""))
    assert session.report is None
    robot.tick = 3
    robot.publish()
    until(lambda: session.report is not None, lambda: session.exchange(b""))
    assert session.report.tick == 4


def test_a_robot_that_ends(session, robot):
    robot.close()
    until(lambda: session.lost, lambda: session.exchange(datagram(1)))
    assert session.stale
    for _ in range(5):  # the host says that nobody listens
        session.order({"order": "disarm"})
        session.exchange(datagram(2))
    robot.__init__()  # for the fixture to close


def test_nobody_there():
    free = socket.socket()
    free.bind(("127.0.0.1", 0))
    port = free.getsockname()[1]
    free.close()
    with pytest.raises(UserError, match=rf"no robot answers at 127.0.0.1:{port}.*ravenjax robot"):
        RemoteRobot("127.0.0.1", port, port, GOLD)
    with pytest.raises(UserError, match="give a host name or an address"):
        RemoteRobot("no.such.host.invalid", port, port, GOLD)


def test_an_arm_that_is_missing(robot):
    with pytest.raises(UserError, match=r"has arms \['gold'\], but the session needs green"):
        RemoteRobot("127.0.0.1", *robot.ports, arms=("gold", "green"))


# --- hardware in the loop: two processes ---

BURST = {"site": "usb_out", "channel": "shoulder", "effect": "overwrite", "value": 20000}
SCENARIO = {
    "name": "loop",
    "arms": ["gold"],
    "hazard": [{"title": "shoulder burst", "fault": [BURST | {"duration_ms": 40}]}],
}
PROGRAM = """
import json, sys
from ravenjax.train import scenario
from ravenjax.train.robot_link import process as robot_process
say = lambda line: print(line, flush=True)
loop = scenario.from_dict(json.loads(sys.argv[1]))
robot_process.run_robot(loop, robot_process.ConsoleOptions(itp_port=0), None, 0, say)
"""


@pytest.fixture(scope="module")
def process():
    """`robot_process.run` in a process of its own, and its ports; the last test ends it."""
    started = subprocess.Popen(
        [sys.executable, "-c", PROGRAM, json.dumps(SCENARIO)],
        stdout=subprocess.PIPE,
        text=True,
        bufsize=1,
    )
    watchdog = threading.Timer(300.0, started.kill)
    watchdog.start()
    ports, lines = [], []
    while len(ports) < 2:
        line = started.stdout.readline()
        assert line, f"the process ended: {lines}"
        lines.append(line)
        if "127.0.0.1:" in line:
            ports.append(int(line.split("127.0.0.1:")[1]))
    yield started, ports
    started.kill()
    started.wait()
    watchdog.cancel()
    started.stdout.close()


@pytest.mark.slow
def test_a_session_with_its_robot_elsewhere(process):
    """The instructor arms a hazard here and it strikes there: reported joints leave the model
    here, the cue pulls.
    """
    _, ports = process
    chosen = scenario.from_dict(SCENARIO)
    session = Session(
        chosen,
        0,
        robot=lambda made: DistantRobot(made, RemoteRobot("127.0.0.1", *ports, arms=GOLD)),
    )
    link = session.robot.remote
    # Numbers mean the same on both sides.
    assert link.greeting["hazards"] == robot_process.hash_hazards(session.hazards)
    frame, events, peak = session.frame, [], {"error": 0.0, "force": 0.0}

    def ticks(count, delta=(0, 0, 0), pedal=True, **more):
        for i in range(count):
            command = increments_of(pedal, {"gold": (delta, (0.0, 0.0, 0.0, 1.0), 0)}, "itp")
            events.extend(session.tick([command] + ([more] if more and i == 0 else [])))
            peak["error"] = max(peak["error"], float(frame["gold/error_mm"][0]))
            peak["force"] = max(peak["force"], float(np.linalg.norm(frame["gold/force"])))
            time.sleep(0.001)

    # The console before this one counts as there for two seconds; the pedal is seen up first.
    ticks(2500, pedal=False)
    until(lambda: frame.number("runlevel") == 2, lambda: ticks(50, pedal=False))
    until(lambda: frame.number("runlevel") == 3, lambda: ticks(50))
    peak.update(error=0.0, force=0.0)
    ticks(200, (20, 0, 0))
    assert frame.number("runlevel") == 3 and peak["error"] < 2 and peak["force"] == 0
    ticks(1, type="instructor", do="arm", hazard=0)
    until(lambda: any(event["kind"] == "hazard_struck" for event in events), lambda: ticks(10))
    ticks(60)
    assert peak["error"] > 3 and peak["force"] > 0
    assert {"hazard_armed", "hazard_struck", "cue"} <= {event["kind"] for event in events}
    link.close()


@pytest.mark.slow
def test_the_process_ends_when_asked_and_says_what_it_saw(process):
    started, ports = process
    session = RemoteRobot("127.0.0.1", *ports, arms=GOLD)
    until(lambda: session.exchange(datagram(1)) is not None, lambda: time.sleep(0.005))
    session.close()
    started.send_signal(signal.SIGTERM)
    told = started.stdout.read()
    assert started.wait(20) == 0
    assert re.search("console: accepted [1-9]", told)
    assert re.search("joint stream: listeners [1-9]", told)
