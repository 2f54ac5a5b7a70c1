"""A robot elsewhere, driven by packets and compared with the model here, goes as the one in this process does."""

import numpy as np
import pytest

from ravenjax.campaign import loading
from ravenjax.robots.raven2.console.packet import decode
from ravenjax.trainer.judge.trips import Trips
from ravenjax.trainer.protocol.frame import FrameLayout
from ravenjax.trainer.robot_link.distant import DistantRobot
from ravenjax.trainer.robot_link.joints.decoder import Decoder
from ravenjax.trainer.robot_link.joints.record import Reporter
from ravenjax.trainer.session import blueprint
from ravenjax.trainer.session.simulation import PacketRobot, SimulatedRobot

pytestmark = pytest.mark.slow

TICKS = 800


class Wire:
    """The other end: a robot that steps when a packet comes, and whose report is back at once."""

    def __init__(self, robot):
        self.robot, self.orders, self.stale = robot, [], False
        self._reporter, self._decoder, self._tick = Reporter(FrameLayout.of(robot.arms)), Decoder(), 0

    def exchange(self, datagram):
        assert len(datagram) == 124
        frame = self.robot.tick(decode(datagram, self.robot.arms))
        self._tick += 1
        return self._decoder.feed(self._reporter.encode(frame, self._tick, self._tick))[-1]

    def order(self, content):
        self.orders.append(content)


@pytest.fixture(scope="module")
def driven():
    """Rows of a robot here and of one elsewhere on the same motion, and the one elsewhere."""
    config = loading.from_dict(
        {
            "campaign": {"name": "far", "duration_s": TICKS / 1000, "arms": ["gold", "green"]},
            "operator": {"motion": "suture", "scale": 0.1},
            "group": [{"name": "estop", "fault": [{"site": "buttons", "channel": "estop", "effect": "overwrite",
                                                   "value": 1, "start_ms": 0}]}],
        }
    )  # fmt: skip
    made = blueprint.make(config)
    far = DistantRobot(made, Wire(PacketRobot(config)))
    rows = []
    for robot in (SimulatedRobot(made), far):
        for column, values in zip(robot.motion, made.plan.columns, strict=True):
            column[: len(values)] = values
        rows.append(np.stack([(robot.step(), robot.row.copy())[1] for _ in range(TICKS)]))
    return made.layout.places, *rows, far


def test_packets_on_the_wire_move_it_as_the_motion_does(driven):
    places, here, there, far = driven
    assert here[-1, places["runlevel"]] == 3 and there[-1, places["runlevel"]] == 3
    for arm in ("gold", "green"):
        for name in ("jpos", "jpos_d", "mpos", "dac"):
            np.testing.assert_allclose(there[:, places[f"{arm}/{name}"]], here[:, places[f"{arm}/{name}"]], atol=2e-6)
    assert far.outcomes() == {}


def test_the_model_here_is_the_model_of_the_tick_and_the_error_that_of_a_tick_ago(driven):
    places, here, there, _ = driven
    for arm in ("gold", "green"):
        for name in ("model_jpos", "model_tip"):
            np.testing.assert_allclose(there[:, places[f"{arm}/{name}"]], here[:, places[f"{arm}/{name}"]], atol=2e-6)
        error = places[f"{arm}/error_mm"]
        # the robot's report of this tick comes after the packet of this tick: one tick of motion, at most 60 mm/s
        assert np.abs(there[1:, error] - here[1:, error]).max() < 0.06
        np.testing.assert_array_equal(there[:, places[f"{arm}/known_mm"]], there[:, error])


def test_what_cannot_be_seen_from_here_is_not_made_up(driven):
    """Without a golden run the model stands for it; whether the report is true nobody here can say."""
    places, here, there, _ = driven
    live = there[1:, places["live"]].ravel() != 0
    np.testing.assert_array_equal(live, here[1:, places["live"]].ravel() != 0)
    was_live = np.concatenate([[False], live[:-1]])  # the distances are of the report before
    for arm in ("gold", "green"):
        error, off = (there[1:, places[f"{arm}/{name}"]].ravel() for name in ("error_mm", "unintended_mm"))
        assert (off <= error + 1e-4).all() and not off[~was_live].any() and off[was_live].any()
        loss = there[1:, places[f"{arm}/loss_mm"]].ravel()
        assert not loss[~was_live].any() and (loss <= error + 1e-4).all()
        assert np.isnan(there[:, places[f"{arm}/false_report_mm"]]).all()
    assert there[-1, places["halted_ms"]] == pytest.approx(here[-1, places["halted_ms"]], abs=2)


def test_orders_go_to_the_robots_process(driven):
    *_, far = driven
    far.arm(0)
    far.press(1)
    far.disarm()
    assert [order["order"] for order in far.remote.orders] == ["arm", "estop", "disarm"]
    assert far.remote.orders[0]["number"] == 0


def test_a_robot_that_is_silent_counts_as_stopped_and_does_not_pull(driven):
    places, *_, far = driven
    assert far.golden_outcomes() is None
    far.remote.stale = True
    far.motion[:, far.now] = far.motion[:, far.now - 1]
    far.step()
    assert far.row[places["runlevel"]] == 0 and not far.row[places["gold/force"]].any()
    assert far.row[places["live"]] == 0


def test_a_robot_that_enters_its_e_stop_has_tripped_a_check(driven):
    places, *_, far = driven
    far.remote.stale = False
    robot = far.remote.robot
    robot.press(robot.blueprint.plan.runs - 1)
    for _ in range(200):
        far.motion[:, far.now] = far.motion[:, far.now - 1]
        far.step()
    outcomes = far.outcomes()
    assert far.row[places["runlevel"]] == 0 and far.row[places["trips"]] == 1
    assert outcomes["check_estop_count"] == 1 and outcomes["check_estop_first_ms"] > TICKS
    (trip,) = Trips().look(far.now, far.now, outcomes)
    assert (trip.check.name, trip.check.response, trip.beyond_golden) == ("estop", "stopped", True)
