"""CRTK beside others: in a robot's station, in a session, and to tell of a robot elsewhere; no
ROS, no clock.
"""

import multiprocessing
import socket
from types import SimpleNamespace

import numpy as np
import pytest
from test_crtk_translation import BOTH, YAML, robot_row

from ravenjax.errors import UserError
from ravenjax.robots.raven2.console.packet import U_STRUCT
from ravenjax.robots.raven2.geometry.arrays import forward_kinematics, motor_from_joint
from ravenjax.train import scenario
from ravenjax.train.protocol.frame import Frame, FrameLayout
from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.robot_link.crtk import messages
from ravenjax.train.robot_link.crtk.bridge import CrtkConsole
from ravenjax.train.robot_link.crtk.interpreter import Interpreter, RobotRow
from ravenjax.train.robot_link.crtk.ros_robot import RosRobot
from ravenjax.train.robot_link.packet_filter import increments_of
from ravenjax.train.robot_link.process import Station
from ravenjax.train.session import pedal
from ravenjax.train.session.advance import Session


class Machine:
    arms = ("gold",)

    def __init__(self):
        self.frame, self.packets, self.acts = Frame(FrameLayout.of(self.arms)), [], []

    def tick(self, packet):
        self.packets.append(packet)
        return self.frame

    def press(self, row):
        self.acts.append("press")

    def reset(self):
        self.acts.append("reset")

    def outcomes(self):
        return {}


class Itp:
    """A console of ITP: what it sends in the next tick, and what it feels."""

    gate = SimpleNamespace(news=list)
    last_sequence = 7

    def __init__(self):
        self.next, self.felt = None, []

    def poll(self):
        return [] if self.next is None else [self.next]

    def send_force(self, forces, runlevel, stopped, pedal, drives):
        self.felt.append((dict(forces), drives))


class Joints:
    def poll(self):
        return []

    def publish(self, record):
        pass


class Ros:
    """A console of CRTK for a station."""

    def __init__(self):
        self.next = []

    def poll(self):
        return self.next

    def tell(self, frame):
        pass


def asks(pedal, x=0):
    table = {"delta_um": [x, 0, 0], "quat": [0.0, 0.0, 0.0, 1.0], "grasp_mrad": 0}
    return {
        "type": "increments",
        "source": "crtk",
        "pedal": pedal,
        "arms": {"gold": table},
        "console": "crtk",
    }


def packets(pedal, x):
    return increments_of(pedal, {"gold": ((x, 0, 0), (0.0, 0.0, 0.0, 1.0), 0)}, "itp")


def test_in_a_station_one_pedal_at_a_time_counts():
    machine, itp, ros = Machine(), Itp(), Ros()
    station = Station(machine, itp, Joints(), 0, 0, ros)

    def tick(count=1):
        for _ in range(count):
            station.tick()
        packet = machine.packets[-1]
        return None if packet is None else (packet.surgeon_mode, int(packet.delta[0][0]))

    ros.next = [asks(True, 3)]
    assert tick()[0] == 0  # it has not been seen up
    ros.next = [asks(False)]
    tick()
    ros.next = [asks(True, 3), asks(True, 4)]
    assert tick() == (1, 7)
    itp.next = packets(False, 50)
    tick()
    itp.next = packets(True, 50)
    assert tick() == (1, 7) and itp.felt[-1] == (
        {"gold": (0.0, 0.0, 0.0)},
        False,
    )  # it watches, and feels nothing
    tick(3)
    ros.next = [
        {"type": "unheard", "console": "crtk", "once": True, "why": "because"},
        asks(True, 7),
    ]
    tick()
    assert station.news() == ["crtk: because"]
    ros.next = [asks(True, 7)]
    tick(60)
    assert station.news() == [f"itp: {pedal.other('crtk')}"]
    ros.next, itp.next = [], None
    assert tick(STALE_MS) is None
    assert tick()[0] == 0  # the process that spoke is gone: nobody holds the pedal
    itp.next = packets(False, 0)
    tick()
    itp.next = packets(True, 50)
    assert tick() == (1, 50) and itp.felt[-1][1]
    ros.next = [asks(True, 9)]
    assert tick() == (1, 50)
    itp.next = packets(False, 0)
    tick()
    assert tick()[0] == 0
    itp.next = None
    assert tick()[0] == 0  # it was pressed while another drove: it does not take over by itself
    ros.next = [asks(False)]
    tick()
    ros.next = [asks(True, 9)]
    assert tick() == (1, 9)
    itp.next, ros.next = (
        packets(False, 0),
        [asks(False), {"type": "operator", "do": "estop", "console": "crtk"}],
    )
    tick()
    ros.next = [asks(True, 9), {"type": "operator", "do": "restart", "console": "crtk"}]
    assert tick()[0] == 0 and machine.acts == ["press", "reset"]  # the pedal must be seen up again


class Transport:
    """What a robot tells, as its bytes would bring it."""

    def __init__(self, ros):
        self.ros, self.types, self.arrivals, self.sent = ros, messages.types(ros), [], []

    def poll(self):
        if self.arrivals is None:
            raise UserError("the node of ROS 1 has ended")
        arrivals, self.arrivals = self.arrivals, []
        return arrivals

    def publish(self, name, message):
        self.sent.append((name, message.string))


@pytest.mark.parametrize("ros", ["ros1", "ros2"])
def test_what_a_robot_tells_over_ros_is_its_joint_report(ros):
    transport = Transport(ros)
    interpreter = Interpreter(BOTH, ("r_grasper",) * 2, transport.types)
    row = robot_row(2)
    row.frame["gold/mvel"] = np.arange(7.0)
    row.frame["gold/mpos"] = motor_from_joint(YAML["gold"][0], "gold")
    interpreter.observe(row, True, row.clock_ns * 1e-6)
    heard = RosRobot.topics(BOTH, ros)[1]
    now = [0]
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as raven:
        raven.bind(("127.0.0.1", 0))
        lines = []
        address = "127.0.0.1", raven.getsockname()[1]
        robot = RosRobot(
            *address, BOTH, ("r_grasper",) * 2, transport, lambda: now[0], lines.append
        )
        assert robot.exchange(bytes(U_STRUCT.itemsize)) is None and robot.stale
        assert len(raven.recv(200)) == U_STRUCT.itemsize
        told = [*interpreter.states(row.stamp_ns), *interpreter.readings(row)]
        transport.arrivals = [one for one in told if one[0] in heard]
        report = robot.exchange(bytes(U_STRUCT.itemsize))
        assert report.runlevel == 2 and not robot.stale
        for arm in BOTH:
            channels = report.channels
            np.testing.assert_allclose(channels[f"{arm}/jpos"], YAML[arm][0], rtol=1e-5)
            np.testing.assert_allclose(channels[f"{arm}/position"], position_of(arm), atol=1e-6)
        np.testing.assert_allclose(report.channels["gold/mvel"], np.arange(7.0), atol=2e-4)
        now[0] = 251_000_000
        assert robot.exchange(bytes(U_STRUCT.itemsize)) is report and robot.stale
        for order in ("estop", "reset", "arm"):
            robot.order({"order": order})
        assert transport.sent == [("state_command", "disable"), ("state_command", "home")]
        transport.arrivals = [one for one in told if one[0] in heard]
        assert robot.exchange(bytes(U_STRUCT.itemsize)) is not report and not robot.stale
        transport.arrivals = None
        for _ in range(2):  # ROS is gone, the session is not
            robot.exchange(bytes(U_STRUCT.itemsize))
            assert robot.stale
        robot.order({"order": "estop"})
        assert len(lines) == 1 and "has ended" in lines[0] and len(transport.sent) == 2
        robot.close()


def position_of(arm):
    return forward_kinematics(YAML[arm][0], arm)[0]


def test_ravenstate_is_read_as_its_publisher_defines_it():
    old = messages.DEFINITIONS[messages.RAVEN_STATE].replace("int32[16] dac_val\n", "")
    old = old.replace("float32[12] jac_vel\nfloat32[12] jac_f\n", "")
    rule = "=" * 80
    text = f"{old}\n{rule}\nMSG: std_msgs/Header\nuint32 seq\ntime stamp\nstring frame_id\n"
    types = messages.MessageTypes("ros1", {messages.RAVEN_STATE: text})
    fields = [name for name, _ in types.store.fielddefs[messages.RAVEN_STATE][1]]
    assert "dac_val" not in fields and "jac_vel" not in fields and fields[0] == "hdr"


@pytest.mark.parametrize(
    ("word", "told"), [("the node of ROS 1 has ended (code -9)", "code -9"), (None, "is gone")]
)
def test_a_terminal_is_told_once_that_nobody_speaks_crtk_any_more(word, told):
    answers, tells = multiprocessing.Pipe(duplex=False)
    lines = []
    console = CrtkConsole(FrameLayout.of(("gold",)), "ros1", lines.append)
    console.process_says = answers
    for _ in range(1000):
        assert console.poll() == []
    assert not lines
    if word:
        tells.send(word)
    tells.close()
    for _ in range(1000):
        assert console.poll() == []
    assert len(lines) == 1 and lines[0].startswith("CRTK over ros1 has ended") and told in lines[0]
    console.close()
    answers.close()


@pytest.mark.slow
def test_a_session_is_driven_by_crtk_tick_by_tick():
    """Also what recordings and judges see: who drives, and whose pedal."""
    session = Session(
        scenario.from_dict({"name": "over_ros", "arms": ["gold"], "duration_s": 60}), 0
    )
    types = messages.types("ros2")
    interpreter = Interpreter(("gold",), ("r_grasper",), types)
    header = types.header(0)
    events = []

    def tick(count, *words):
        for _ in range(count):
            ms = float(session.ticks)
            interpreter.observe(
                RobotRow(session.frame, session.ticks * 10**6, session.ticks * 10**6, 10**9),
                True,
                ms,
            )
            for name, message in words:
                interpreter.hear(name, message, ms)
            events.extend(session.tick(interpreter.commands(ms)))

    def setpoint():
        row = RobotRow(session.frame, 1, 1, 0)
        return next(
            message for name, message in interpreter.readings(row) if name == "arm1/setpoint_cp"
        ).pose

    session.tick([])  # nothing is told before there is a row
    tick(300)
    assert session.arbiter.owner == "nobody" and interpreter.state.state == "DISABLED"
    tick(1, ("state_command", types.message(messages.STRING, header, "enable")))
    tick(200)
    assert session.arbiter.owner == "crtk" and interpreter.state.state == "ENABLED"
    start = setpoint()
    p, q = start.position, start.orientation
    goal = p.x + 0.004, p.y - 0.002, p.z + 0.003
    pose = types.message(messages.POSE, header, (goal, (q.x, q.y, q.z, q.w)))
    tick(200, ("arm1/servo_cp", pose))
    poses = setpoint().position
    assert (poses.x, poses.y, poses.z) == pytest.approx(goal, abs=5e-6)
    tick(300)  # nothing more is said: the pedal comes up
    assert interpreter.state.state == "PAUSED" and interpreter.state.why == "silence"
    assert session.frame.number("pedal") == 0
    tick(1, ("state_command", types.message(messages.STRING, header, "disable")))
    tick(200)
    assert session.frame.number("runlevel") == 0 and interpreter.state.state == "DISABLED"
    tick(1, ("state_command", types.message(messages.STRING, header, "enable")))
    tick(300)
    assert interpreter.state.state == "ENABLED" and session.frame.number("runlevel") == 3
    assert [event["console"] for event in events if event["kind"] == "owner"] == ["crtk"]
