"""A robot elsewhere, driven by packets and compared with the model here, goes as the one in this
process does.
"""

import numpy as np
import pytest
from closed_loop import decode

from ravenjax.campaign import loading
from ravenjax.train import scenario
from ravenjax.train.judge import Trips
from ravenjax.train.protocol import PHASES
from ravenjax.train.robot_link.distant import DistantRobot
from ravenjax.train.robot_link.itp import increments_of, packet_of
from ravenjax.train.robot_link.joint_stream import JointReport, encode_report
from ravenjax.train.session.advance import Session
from ravenjax.train.session.simulation import PacketRobot, SimulatedRobot, make_blueprint

pytestmark = pytest.mark.slow

TICKS = 800
BUTTON = {"site": "buttons", "channel": "estop", "effect": "overwrite", "value": 1, "start_ms": 0}


class Wire:
    """The other end: a robot that steps when a packet comes, and whose report is back at once."""

    def __init__(self, robot):
        self.robot, self.orders, self.stale = robot, [], False
        self.report, self._tick = None, 0

    def exchange(self, datagram):
        assert len(datagram) == 124
        frame = self.robot.tick(decode(datagram, self.robot.arms))
        self._tick += 1
        line = encode_report(frame, self._tick, self._tick, {})
        self.report = JointReport.model_validate_json(line)
        return self.report

    def order(self, content):
        self.orders.append(content)


@pytest.fixture(scope="module")
def driven():
    """Rows of a robot here and of one elsewhere on the same motion, and the one elsewhere."""
    config = loading.from_dict(
        {
            "campaign": {"name": "far", "duration_s": TICKS / 1000, "arms": ["gold", "green"]},
            "operator": {"motion": "suture", "scale": 0.1},
            "group": [{"name": "estop", "fault": [BUTTON]}],
        }
    )
    made = make_blueprint(config)
    far = DistantRobot(made, Wire(PacketRobot(config)))
    rows = []
    for robot in (SimulatedRobot(made), far):
        for column, values in zip(robot.motion, made.plan.columns, strict=True):
            column[: len(values)] = values
        rows.append(np.stack([(robot.step(), robot.row.copy())[1] for _ in range(TICKS)]))
    return made.layout.places, *rows, far


def test_packets_on_the_wire_move_it_as_the_motion_does_and_the_error_is_that_of_a_tick_ago(driven):
    places, here, there, far = driven
    assert here[-1, places["runlevel"]] == 3 and there[-1, places["runlevel"]] == 3
    for arm in ("gold", "green"):
        for name in ("jpos", "jpos_d", "mpos", "dac"):
            place = places[f"{arm}/{name}"]
            np.testing.assert_array_equal(there[:, place], here[:, place])
        for name in ("model_jpos", "model_tip"):
            place = places[f"{arm}/{name}"]
            np.testing.assert_allclose(there[:, place], here[:, place], atol=2e-6)
        error = places[f"{arm}/error_mm"]
        # the robot's report of this tick comes after the packet of this tick: one tick of motion,
        # at most 60 mm/s
        assert np.abs(there[1:, error] - here[1:, error]).max() < 0.06
        np.testing.assert_array_equal(there[:, places[f"{arm}/known_mm"]], there[:, error])
    assert far.outcomes() == {}


def test_a_robot_that_is_silent_counts_as_stopped_and_does_not_pull(driven):
    places, *_, far = driven
    assert far.golden_outcomes() is None
    far.remote.stale = True
    far.motion[:, far.next_tick] = far.motion[:, far.next_tick - 1]
    far.step()
    assert far.row[places["runlevel"]] == 0 and not far.row[places["gold/force"]].any()
    assert far.row[places["live"]] == 0


def test_a_robot_that_enters_its_e_stop_has_tripped_a_check(driven):
    places, *_, far = driven
    far.remote.stale = False
    robot = far.remote.robot
    robot.press_estop(robot.blueprint.plan.runs - 1)
    for _ in range(200):
        far.motion[:, far.next_tick] = far.motion[:, far.next_tick - 1]
        far.step()
    outcomes = far.outcomes()
    assert far.row[places["runlevel"]] == 0 and far.row[places["trips"]] == 1
    assert outcomes["check_estop_count"] == 1 and outcomes["check_estop_first_ms"] > TICKS
    (trip,) = Trips().new_trips(far.next_tick, far.next_tick, outcomes)
    assert (trip.check.name, trip.check.response, trip.exceeds_golden) == ("estop", "stopped", True)


def test_a_robot_that_nothing_is_heard_of_is_a_lost_link_and_not_a_stop():
    chosen = scenario.from_dict({"name": "far", "duration_s": 30, "task": {"kind": "free"}})
    wires = []

    def robot(made):
        wires.append(Wire(PacketRobot(scenario.session_campaign(chosen, 0))))
        return DistantRobot(made, wires[0])

    session, events = Session(chosen, 0, robot=robot), []

    def drive(ticks, pedal=True):
        for k in range(ticks):
            hand = {"type": "input", "pedal": pedal, "arms": {"gold": {"move": [0.5, 0.0, 0.0]}}}
            events.extend(session.tick([hand] if k % 20 == 0 else []))
        return PHASES[int(session.frame.number("phase"))]

    drive(100, pedal=False)
    assert drive(500) == "running" and session.frame.number("link") == 1
    events.clear()
    wires[0].stale = True
    assert drive(500) == "lost" and session.frame.number("link") == 0
    assert not session.frame["gold/force"].any()
    # No alarm, no run level.
    assert {event["kind"] for event in events} == {"phase", "pedal", "rearm"}
    wires[0].stale = False
    assert drive(500) == "ready" and session.frame.number("pedal") == 0  # the foot never came up
    drive(100, pedal=False)
    assert drive(500) == "running"


def test_the_model_begins_where_the_robot_stands():
    chosen = scenario.from_dict({"name": "far", "duration_s": 30, "task": {"kind": "free"}})
    robot, number = PacketRobot(scenario.session_campaign(chosen, 0)), 0
    for pedal, ticks, um in ((0, 20, 0), (1, 300, 0), (1, 300, 60), (0, 300, 0)):
        for _ in range(ticks):
            number += 1
            moved = {"gold": ((um, 0, 0), (0.0, 0.0, 0.0, 1.0), 0)}
            command = increments_of(pedal, moved, "itp")
            robot.tick(packet_of(command, ("gold",), number))
    session = Session(chosen, 0, robot=lambda made: DistantRobot(made, Wire(robot)))
    start = session.blueprint.plan.motion.start_jpos[0]
    for _ in range(100):
        session.tick([])
    assert np.abs(session.frame["gold/jpos"] - start).max() > 0.01
    assert session.frame.number("gold/error_mm") < 0.1
