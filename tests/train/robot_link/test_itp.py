"""The ITP server on real loopback sockets, driven by a console that shares no code with it."""

import math

import numpy as np
import pytest
from itp_client import IDENTITY, STILL, Clock, Console, datagram

from ravenjax.errors import UserError
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console.profile import LargestSteps
from ravenjax.robots.raven2.geometry import mapping
from ravenjax.train.protocol import STALE_MS, Frame, FrameLayout
from ravenjax.train.robot_link.itp import (
    DEFAULT_PACKETS_PER_TICK,
    MIN_DATAGRAMS_PER_TICK,
    Gate,
    ItpServer,
    force_at_hand,
)

BOTH = ("gold", "green")


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def server(clock):
    made = ItpServer(Gate(BOTH), port=0, clock=clock)
    yield made
    made.close()


@pytest.fixture
def console(server):
    made = Console(server.address)
    yield made
    made.close()


def polled(server, ticks=1):
    """Everything said in so many ticks."""
    return [message for _ in range(ticks) for message in server.poll()]


def test_binds_loopback_and_says_when_the_port_is_taken(server):
    host, port = server.address
    assert host == "127.0.0.1"
    with pytest.raises(UserError, match=rf"UDP 127.0.0.1:{port} cannot be opened.*another port"):
        ItpServer(Gate(BOTH), port=port)


def test_packets_of_a_tick_add_up_in_their_order(server, console):
    about_x, about_y = (
        (math.sin(0.02), 0.0, 0.0, math.cos(0.02)),
        (0.0, math.sin(0.03), 0.0, math.cos(0.03)),
    )
    console.send(gold=(1, 2, 3), grasp=(5, 0), quats=(about_x, IDENTITY), surgeon_mode=1)
    console.send(gold=(10, 20, 30), grasp=(-7, 0), quats=(about_y, IDENTITY), surgeon_mode=0)
    (message,) = server.poll()
    gold = message["arms"]["gold"]
    assert (gold["delta_um"], gold["grasp_mrad"], message["pedal"]) == ([11, 22, 33], -2, False)
    robot = mapping.matrix_from_quat(
        Vec(gold["quat"])
    )  # the robot multiplies later turns from the left
    steps = [np.array(mapping.matrix_from_quat(Vec(q))) for q in (about_x, about_y)]
    np.testing.assert_allclose(np.array(robot), steps[1] @ steps[0], atol=1e-12)


def test_a_burst_is_spread_over_ticks(server, console):
    for _ in range(11):
        console.send(gold=(100, 0, 0))
    each = [m["arms"]["gold"]["delta_um"][0] for m in polled(server, 4)]
    assert each == [400, 400, 300]
    assert DEFAULT_PACKETS_PER_TICK * LargestSteps().step_um <= 4000, (
        "what bounds the displacement of a tick"
    )


def test_a_flood_costs_a_tick_no_more_than_its_share_and_is_counted(server, console):
    console.send(gold=(5, 0, 0))
    polled(server)
    flooder = Console(server.address)
    for _ in range(5000):
        flooder.send_bytes(datagram(1, gold=(900, 0, 0)))
    assert server.poll() == []
    assert server.counters()["stranger"] == MIN_DATAGRAMS_PER_TICK
    assert polled(server, 100) == []
    console.send(gold=(6, 0, 0))
    assert polled(server)[0]["arms"]["gold"]["delta_um"] == [6, 0, 0]
    flooder.close()


def test_force_in_the_axes_of_the_console(server, console, clock):
    console.send(surgeon_mode=1)
    server.poll()
    gold, green = (0.01, -0.02, 0.03), (0.0, 0.0, 0.05)
    server.send_force({"gold": np.float32(gold), "green": green}, runlevel=3)
    got = console.force()
    for arm, felt in (
        ("gold", gold),
        ("green", green),
    ):  # spec 5.2: frame 0 of gold is (-z, -x, y) of the console
        x, y, z = got[arm]
        assert {"gold": (-z, -x, y), "green": (-z, x, -y)}[arm] == tuple(
            round(1000 * f) for f in felt
        )
    assert (got["sequence"], got["last_sequence"], got["runlevel"]) == (1, 1, 3)
    assert got["jointflags"] == 0b11_0010_1111
    server.send_force({"gold": STILL, "green": STILL}, runlevel=0, soft_estopped=True)
    assert console.force()["jointflags"] == 0b1_1111 | 0b10_0000
    assert got["checksum"] == sum(got["gold"]) + sum(got["green"]) + 3 + 1


@pytest.mark.parametrize(
    ("felt", "sent"),
    [((math.nan, 0, 0), STILL), ((math.inf, 0, -1e30), (0, -(2**31 - 1), -(2**31 - 1)))],
)
def test_a_force_that_fits_no_32_bits_is_none_or_the_greatest(server, console, felt, sent):
    console.send()
    server.poll()
    server.send_force({"gold": felt})
    assert console.force()["gold"] == sent


def test_a_dead_console_gets_no_force_and_its_pedal_counts_as_up(server, console, clock):
    console.send(surgeon_mode=1)
    server.poll()
    clock.ms += STALE_MS
    server.send_force({"gold": (0.05, 0, 0)})
    assert any(console.force()["gold"])
    clock.ms += 0.1
    server.send_force({"gold": (0.05, 0, 0)}, runlevel=3)
    got = console.force()
    assert (got["gold"], got["jointflags"], got["runlevel"]) == (STILL, 0b10_0011, 3)
    clock.ms += 2000
    sent = server.counters()["force_sent"]
    server.send_force({"gold": (0.05, 0, 0)})
    assert server.counters()["force_sent"] == sent, "nobody is there any more"


def test_force_at_the_hand_is_that_of_the_row():
    frame = Frame(FrameLayout.of(BOTH))
    frame.row[frame.layout.places["green/force"]] = 0.0, 0.01, 0.0
    assert force_at_hand(frame, "green", 0.0, 0.05, True) == pytest.approx((0.0, 0.01, 0.0))
