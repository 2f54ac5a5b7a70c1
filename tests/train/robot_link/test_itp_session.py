"""A console that knows the protocol's description alone drives a session: good packets move it,
others nothing.
"""

import numpy as np
import pytest
from itp_books import BOOKED, Books
from itp_client import STILL, Console, datagram

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.geometry import kinematics, mapping
from ravenjax.train import scenario
from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.robot_link.itp import ItpServer
from ravenjax.train.session.advance import Session


class Driven:
    """A session, its server, and a clock that goes with its ticks."""

    def __init__(self, arms):
        self.arms = arms
        self.session = Session(
            scenario.from_dict({"name": "itp", "arms": list(arms), "duration_s": 200}), 0
        )
        self.server = ItpServer(arms, port=0, clock=lambda: self.session.ticks * 1_000_000)
        self.console, self.stranger = Console(self.server.address), Console(self.server.address)
        self.count = 0

    def tick(self, count=1):
        for _ in range(count):
            self.session.tick(self.server.poll())
            self.server.send_force(
                {arm: self.session.frame[f"{arm}/force"] for arm in self.arms}, runlevel=3
            )
        return self.session.frame

    def send(self, packets, stranger=False):
        """Send as fast as the kernel holds, and tick until everything was looked at."""
        sender = self.stranger if stranger else self.console
        for first in range(0, len(packets), 50):
            for packet in packets[first : first + 50]:
                sender.send_bytes(packet)
                self.count += 1
            while self.server.gate.received < self.count:
                self.tick()

    def pedal_down(self, books):
        """Until the robot follows, with nothing asked; the pedal is seen up first."""
        for _ in range(2):  # the first packet of a stream may be lost
            books.sequence += 1
            self.send([datagram(books.sequence, surgeon_mode=0)])
        for _ in range(100):
            books.sequence += 1
            self.send([datagram(books.sequence)])
        assert self.tick().number("runlevel") == 3

    def desired(self):
        """Tips that the control software wants, um, frame 0."""
        tips = {}
        for arm in self.arms:
            pose = kinematics.forward(
                arm, Vec(self.session.frame[f"{arm}/jpos_d"].astype(float).tolist())
            )
            tips[arm] = np.array([float(x) * 1e6 for x in pose.position])
        return tips

    def close(self):
        for one in (self.console, self.stranger, self.server):
            one.close()


@pytest.fixture(scope="module")
def driven():
    made = Driven(("gold", "green"))
    yield made
    made.close()


@pytest.mark.slow
def test_no_bad_packet_moves_the_robot(driven):
    """Good packets among bad ones, on a real socket: the tips that the robot wants are where the
    books have them.
    """
    datagrams = 20_000
    books = Books(datagrams, pedal=(1,), step=10)
    driven.tick(2001)  # an earlier console is forgotten
    driven.pedal_down(books)
    start, first, counts = driven.desired(), driven.count, dict(driven.server.gate.counts)
    while driven.count - first < datagrams:
        driven.send([books.good()])
        if books.random.random() < 0.3:
            bad, elsewhere = books.bad()
            driven.send(bad, elsewhere)
    frame = driven.tick(3)
    assert driven.server.counters()["kernel_dropped"] == 0, "every one was seen"
    assert sum(driven.server.gate.counts.values()) == driven.count
    assert frame.number("runlevel") == 3
    for i, arm in enumerate(driven.arms):
        asked = mapping.position_from_itp(arm, Vec(books.um[3 * i : 3 * i + 3]))
        np.testing.assert_allclose(
            driven.desired()[arm] - start[arm], asked, atol=2.0
        )  # float32 joints, whole um
    assert all(driven.server.gate.counts[cause] > counts[cause] for cause in BOOKED)
    assert max(abs(x) for x in books.um) > 100, "it has been somewhere"


@pytest.mark.slow
def test_a_console_that_dies_lets_go_of_the_pedal(driven):
    books = Books(0)
    driven.tick(2001)
    driven.pedal_down(books)
    driven.tick(STALE_MS - 5)
    assert driven.session.frame.number("pedal") == 1
    frame = driven.tick(10)
    assert (frame.number("pedal"), frame.number("console_alive")) == (0, 0)
    driven.console.drain()
    driven.tick()
    told = driven.console.force()
    assert (told["gold"], told["jointflags"] & 0b100) == (STILL, 0)
    assert driven.tick(20).number("runlevel") == 2, "the robot has its pedal up"


@pytest.mark.slow
def test_the_same_motion_by_itp_turns_and_grasps(driven):
    """A turn of the console turns the instrument about the mapped axis, and a grasp closes the
    jaws.
    """
    books = Books(0)
    driven.tick(2001)
    driven.pedal_down(books)
    before = driven.session.frame["gold/jpos_d"].copy()
    half = 0.0005
    turn = (np.sin(half), 0.0, 0.0, np.cos(half))
    for _ in range(100):
        books.sequence += 1
        driven.send([datagram(books.sequence, quats=(turn, (0.0, 0.0, 0.0, 1.0)), grasp=(1, 0))])
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
