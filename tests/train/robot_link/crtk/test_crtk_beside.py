"""CRTK beside others: in a robot's station, in a session, and to tell of a robot elsewhere; no
ROS, no clock.
"""

import socket

import numpy as np
import pytest
from test_crtk_translation import BOTH, YAML, robot_row

from ravenjax.errors import UserError
from ravenjax.robots.raven2.console.packet import U_STRUCT
from ravenjax.robots.raven2.geometry.arrays import forward_kinematics, motor_from_joint
from ravenjax.train.robot_link.crtk import messages
from ravenjax.train.robot_link.crtk.interpreter import Interpreter
from ravenjax.train.robot_link.crtk.ros_robot import RosRobot


class Transport:
    """What a robot tells, as its bytes would bring it."""

    def __init__(self, ros):
        self.ros, self.types, self.arrivals, self.sent = ros, messages.message_types(ros), [], []

    def poll(self):
        if self.arrivals is None:
            raise UserError("the node of ROS 1 has ended")
        arrivals, self.arrivals = self.arrivals, []
        return arrivals

    def publish(self, name, message):
        self.sent.append((name, message.string))


@pytest.mark.parametrize("ros", ["ros1", "ros2"])
def test_what_a_robot_tells_over_ros_is_its_joint_report(ros, monkeypatch):
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
        monkeypatch.setattr(RosRobot, "clock", lambda _: now[0])
        robot = RosRobot(*address, BOTH, ("r_grasper",) * 2, transport, lines.append)
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
