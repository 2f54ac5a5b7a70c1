"""Joint reports and their stream: what they say, slow listeners, orders."""

import json
import socket

import numpy as np
import pytest
import waiting

from ravenjax.train.protocol import Frame, FrameLayout
from ravenjax.train.robot_link.joint_stream import (
    BUFFER_BYTES,
    MAX_ORDER_BYTES,
    JointReport,
    JointServer,
    encode_report,
)

GREETING = {"robot": "ravenjax"}


def example(arms, seed=0):
    """A frame with different numbers everywhere."""
    rng, frame = np.random.default_rng(seed), Frame(FrameLayout.of(arms))
    frame.row[:] = rng.uniform(-0.5, 0.5, frame.row.size)
    frame["runlevel"], frame["surgeon_mode"], frame["plc_runlevel"] = 3, 1, 2
    frame["soft_estopped"], frame["brakes"], frame["fault_active"] = 0, 1, 1
    return frame


def line(tick):
    return encode_report(example(("gold", "green")), tick, tick + 111, {})


def test_a_report_brings_its_channels_into_a_frame():
    sent = example(("green",))
    text = encode_report(sent, 5, 6, {"joint_limit": (3, 4)})
    report = JointReport.model_validate_json(text)
    assert report.checks == {"joint_limit": (3, 4)}
    got = Frame(FrameLayout.of(("gold", "green")))
    report.fill(got)
    assert (got.number("tick"), got.number("last_seq")) == (5, 6)
    names = ("runlevel", "surgeon_mode", "plc_runlevel", "soft_estopped", "brakes", "fault_active")
    assert [got.number(name) for name in names] == [sent.number(name) for name in names]
    for name in ("jpos", "jpos_d", "mpos", "mvel", "dac", "position"):
        np.testing.assert_array_equal(got[f"green/{name}"], sent[f"green/{name}"])
    np.testing.assert_array_equal(got["green/tip"], sent["green/position"])
    assert not got["gold/jpos"].any()


# --- the server ---


@pytest.fixture
def server():
    made = JointServer(GREETING, "127.0.0.1", 0)
    yield made
    made.close()


class Listener:
    """A connection, and the lines that came."""

    def __init__(self, server, **options):
        self.socket, self._rest = socket.socket(), b""
        for name, value in options.items():
            self.socket.setsockopt(socket.SOL_SOCKET, getattr(socket, name), value)
        self.socket.connect(server.address)
        self.socket.settimeout(waiting.DEADLINE_S)
        came = lambda: server.counts["listeners"]  # noqa: E731
        before = came()
        until(server, lambda: came() > before)

    def some(self):
        *lines, self._rest = (self._rest + self.socket.recv(65536)).split(b"\n")
        return [json.loads(line) for line in lines]

    def heard(self, count):
        """The next `count` objects of the stream."""
        found = []
        while len(found) < count:
            found += self.some()
        return [one.get("tick", one) for one in found]

    def order(self, **content):
        self.socket.sendall(json.dumps(content).encode() + b"\n")


@pytest.fixture
def listen():
    made = []
    yield lambda *words, **options: (made.append(Listener(*words, **options)), made[-1])[1]
    for one in made:
        one.socket.close()


def until(server, done):
    """Poll until `done`; the orders heard meanwhile."""
    orders = []
    waiting.until(lambda: (orders.extend(server.poll()), done())[1], every_s=0.005)
    return orders


def test_a_slow_listener_loses_whole_lines_and_holds_up_nobody(server, listen):
    slow, quick = listen(server, SO_RCVBUF=4096), listen(server)
    count, ticks = 1000, quick.heard(1)[1:]
    for tick in range(count):
        server.publish(line(tick))
        ticks += [one["tick"] for one in quick.some()]
    while ticks[-1] < count - 1:
        ticks += quick.heard(1)
    assert ticks == list(range(count))
    dropped = server.counts["records_dropped"]
    assert dropped > count / 4
    assert all(len(one._outgoing) <= BUFFER_BYTES for one in server.listeners)
    got = []
    while len(got) < count - dropped + 1:
        got += slow.some()
        for one in server.listeners:  # what waited goes out as room comes
            one.send()
    numbers = [one["tick"] for one in got[1:]]
    assert numbers == sorted(set(numbers)) and len(numbers) == count - dropped


def test_orders_and_answers(server, listen):
    client = listen(server)
    client.order(order="arm", number=3)
    orders = []
    for piece in (b'{"order"', b': "si', b'ng"}\n{"or'):
        client.socket.sendall(piece)
        orders += server.poll()
    orders += until(server, lambda: server.counts["orders"] == 2)
    assert [content for _, content in orders] == [{"order": "arm", "number": 3}, {"order": "sing"}]
    server.answer(orders[1], "no such order")
    assert client.heard(2)[1:] == [{"answer": "sing", "ok": False, "error": "no such order"}]


@pytest.mark.parametrize(
    "content",
    [
        b"POST / HTTP/1.1\r\n\r\n" + b'{"order": "estop"}\n',
        b"[1, 2]\n",
        b'{"order": ' + b"[" * 900 + b"\n",
        b"x" * (MAX_ORDER_BYTES + 1),
        bytes(range(256)) + b"\n",
    ],
)
def test_what_is_no_order_ends_the_connection(server, listen, content):
    client = listen(server)
    client.socket.sendall(content)
    assert until(server, lambda: server.counts["garbled"] == 1) == [] and server.listeners == []
    client.heard(1)
    assert client.socket.recv(10) == b""


@pytest.mark.parametrize(
    ("token", "given", "allowed"),
    [
        (None, {}, False),
        (None, {"token": None}, False),
        ("secret", {}, False),
        ("secret", {"token": "\ud800"}, False),
        ("secret", {"token": ["secret"]}, False),
        ("secret", {"token": "secret"}, True),
    ],
)
def test_from_another_machine_only_with_the_token(listen, token, given, allowed):
    server = JointServer(GREETING, "127.0.0.1", 0, token)
    client = listen(server)
    server.listeners[0].local = False  # as if it were not on this machine
    client.order(order="estop", **given)
    orders = until(server, lambda: server.counts["orders"] + server.counts["orders_refused"])
    assert bool(orders) == allowed
    if not allowed:
        answer = client.heard(2)[1]
        assert (answer["ok"], answer["answer"]) == (False, "estop") and "token" in answer["error"]
    server.close()
