"""A console that knows the protocol's description alone drives a session."""

import numpy as np
import pytest
from itp_client import Console

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import kinematics, mapping
from ravenjax.train import scenario
from ravenjax.train.robot_link.itp import ItpServer
from ravenjax.train.session.advance import Session


class Driven:
    """A session, its server, and a clock that goes with its ticks."""

    def __init__(self):
        self.session = Session(scenario.from_dict({"name": "itp", "duration_s": 200}), 0)
        arms = self.session.arms
        self.server = ItpServer(arms, port=0, clock=lambda: self.session.ticks * 1_000_000)
        self.console = Console(self.server.address)

    def tick(self, count=1):
        for _ in range(count):
            self.session.tick(self.server.poll())
            forces = {arm: self.session.frame[f"{arm}/force"] for arm in self.session.arms}
            self.server.send_force(forces, runlevel=3)
        return self.session.frame

    def send(self, count=1, **fields):
        """Send packets, and tick until they were looked at."""
        for _ in range(count):
            self.console.send(**fields)
            while self.server.gate.received < self.console.sequence:
                self.tick()

    def pedal_down(self):
        """Until the robot follows, with nothing asked; the pedal is seen up first."""
        self.send(2, surgeon_mode=0)  # the first packet of a stream may be lost
        self.send(100)
        assert self.tick().number("runlevel") == 3

    def close(self):
        self.console.close()
        self.server.close()


@pytest.fixture
def driven():
    made = Driven()
    yield made
    made.close()


@pytest.mark.slow
def test_the_same_motion_by_itp_turns_and_grasps(driven):
    """A turn of the console turns the instrument about the mapped axis, and a grasp closes the
    jaws.
    """
    driven.pedal_down()
    before = driven.session.frame["gold/jpos_d"].copy()
    half = 0.0005
    turn = (np.sin(half), 0.0, 0.0, np.cos(half))
    driven.send(100, quats=(turn, (0.0, 0.0, 0.0, 1.0)), grasp=(1, 0))
    driven.tick(3)
    after = driven.session.frame["gold/jpos_d"]
    rotations = [
        np.array(kinematics.forward("gold", Vec(j.astype(float).tolist())).rotation, float)
        for j in (before, after)
    ]
    turned = rotations[1] @ rotations[0].T
    axis = np.array(mapping.position_from_itp("gold", Vec((1.0, 0.0, 0.0))), float)
    np.testing.assert_allclose(turned @ axis, axis, atol=1e-4)
    assert np.arccos((np.trace(turned) - 1) / 2) == pytest.approx(200 * half, rel=0.01)
    assert (after[5] + after[6]) - (before[5] + before[6]) == pytest.approx(-0.1, abs=0.002)
