"""Joint records and their stream: the layout, slow listeners, orders."""

import json
import socket
import struct
import zlib

import numpy as np
import pytest
import waiting
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.errors import UserError
from ravenjax.train.protocol.frame import Frame, FrameLayout
from ravenjax.train.robot_link.joint_record import (
    RECORD,
    Decoder,
    JointReport,
    Reporter,
    encode_text,
)
from ravenjax.train.robot_link.joint_server import (
    BUFFER_BYTES,
    LONGEST_LINE,
    MOST_CLIENTS,
    JointServer,
)

BOTH = ("gold", "green")
GREETING = {"robot": "ravenjax"}


def example(arms=BOTH, seed=0):
    """A frame with different numbers everywhere."""
    rng, frame = np.random.default_rng(seed), Frame(FrameLayout.of(arms))
    frame.row[:] = rng.uniform(-0.5, 0.5, frame.row.size)
    frame["runlevel"], frame["surgeon_mode"], frame["plc_runlevel"] = 3, 1, 2
    frame["soft_estopped"], frame["brakes"], frame["fault_active"] = 0, 1, 1
    for arm in arms:
        frame[f"{arm}/dac"] = rng.integers(-30000, 30000, 7)
    return frame


def records(count, arms=BOTH):
    reporter = Reporter(FrameLayout.of(arms))
    return [reporter.encode(example(arms, seed), seed, seed + 111) for seed in range(count)]


def test_layout_as_documented():
    """Read with `struct` and the table of the docstring alone."""
    frame = example()
    whole = Reporter(FrameLayout.of(BOTH)).encode(frame, tick=7, last_seq=9)
    assert len(whole) == RECORD.itemsize == 304
    assert struct.unpack_from("<4sHHIBBHI", whole) == (b"RVNJ", 1, 304, 7, 3, 1, 0b11_0010_0110, 9)
    for i, arm in enumerate(BOTH):
        at = 20 + 140 * i
        for k, name in enumerate(("jpos", "jpos_d", "mpos", "mvel")):
            assert struct.unpack_from("<7f", whole, at + 28 * k) == tuple(frame[f"{arm}/{name}"])
        um = struct.unpack_from("<3i", whole, at + 112)
        np.testing.assert_allclose(um, frame[f"{arm}/position"] * 1e6, atol=0.6)
        assert struct.unpack_from("<7h", whole, at + 124) == tuple(frame[f"{arm}/dac"])
    assert struct.unpack_from("<I", whole, 300)[0] == zlib.crc32(whole[:300])


def test_one_arm_and_back_into_a_frame():
    sent = example(("green",))
    (report,) = Decoder().feed(Reporter(FrameLayout.of(("green",))).encode(sent, 5, 6))
    assert isinstance(report, JointReport)
    assert (report.arms, report.tick, report.last_seq, report.runlevel) == (("green",), 5, 6, 3)
    assert not report["gold"]["jpos"].any()
    got = Frame(FrameLayout.of(BOTH))
    report.fill(got)
    names = ("runlevel", "surgeon_mode", "plc_runlevel", "soft_estopped", "brakes", "fault_active")
    assert [got.number(name) for name in names] == [sent.number(name) for name in names]
    for name in ("jpos", "jpos_d", "mpos", "mvel", "dac"):
        np.testing.assert_array_equal(got[f"green/{name}"], sent[f"green/{name}"])
    np.testing.assert_allclose(got["green/tip"], sent["green/position"], atol=6e-7)
    assert not got["gold/jpos"].any()


@given(st.lists(st.integers(1, 700), min_size=1, max_size=20))
def test_any_pieces_make_the_same_records(sizes):
    sent = [*records(3), encode_text({"answer": "arm", "ok": True}), *records(2)]
    stream, decoder, found = b"".join(sent), Decoder(), []
    while stream:
        size = sizes[len(found) % len(sizes)]
        found += decoder.feed(stream[:size])
        stream = stream[size:]
    assert [r["answer"] if isinstance(r, dict) else r.tick for r in found] == [0, 1, 2, "arm", 0, 1]


@given(st.integers(0, 303), st.integers(0, 7))
def test_a_stream_with_a_wrong_bit_is_refused(at, bit):
    content = bytearray(records(1)[0] + encode_text({"more": "than" * 2000}))
    content[at] ^= 1 << bit
    with pytest.raises(ValueError, match="record"):
        Decoder().feed(content)


# --- the server ---


@pytest.fixture
def server():
    made = JointServer(GREETING, "127.0.0.1", 0)
    yield made
    made.close()


def listener(server, **options):
    made = socket.socket()
    for name, value in options.items():
        made.setsockopt(socket.SOL_SOCKET, getattr(socket, name), value)
    made.connect(server.address)
    made.settimeout(waiting.DEADLINE_S)
    came = lambda: server.counts["listeners"] + server.counts["turned_away"]  # noqa: E731
    before = came()
    until(server, lambda: came() > before)
    return made


def until(server, done):
    """Poll until `done`; the orders heard meanwhile."""
    orders = []
    waiting.until(lambda: (orders.extend(server.poll()), done())[1], every_s=0.005)
    return orders


def heard(connection, count):
    """The next `count` records of a stream."""
    decoder, found = Decoder(), []
    while len(found) < count:
        found += decoder.feed(connection.recv(65536))
    return found


def test_listeners_come_and_go(server):
    sent = records(3)
    server.publish(sent[0])
    first = listener(server)
    server.publish(sent[1])
    second = listener(server)
    server.publish(sent[2])
    assert [r if isinstance(r, dict) else r.tick for r in heard(first, 3)] == [GREETING, 1, 2]
    assert [r if isinstance(r, dict) else r.tick for r in heard(second, 2)] == [GREETING, 2]
    first.close()
    until(server, lambda: len(server.listeners) == 1)
    server.publish(sent[0])
    assert heard(second, 1)[0].tick == 0
    second.close()


def test_a_slow_listener_loses_whole_records_and_holds_up_nobody(server):
    slow, quick = listener(server, SO_RCVBUF=4096), listener(server)
    decoder, ticks = Decoder(), []
    reporter, frame = Reporter(FrameLayout.of(BOTH)), example()
    count = 3000
    for tick in range(count):
        server.publish(reporter.encode(frame, tick, 0))
        ticks += [r.tick for r in decoder.feed(quick.recv(65536)) if isinstance(r, JointReport)]
    while ticks[-1] < count - 1:
        ticks += [r.tick for r in decoder.feed(quick.recv(65536))]
    assert ticks == list(range(count))
    dropped = server.counts["records_dropped"]
    assert dropped > count / 2
    assert all(len(one.waiting) <= BUFFER_BYTES for one in server.listeners)
    got, late = [], Decoder()
    while len(got) < count - dropped + 1:
        got += late.feed(slow.recv(65536))
        for one in server.listeners:  # what waited goes out as room comes
            server._push(one, b"")
    numbers = [r.tick for r in got[1:]]
    assert numbers == sorted(set(numbers)) and len(numbers) == count - dropped
    slow.close()
    quick.close()


def test_more_than_enough_listeners_are_turned_away(server):
    connections = [listener(server) for _ in range(MOST_CLIENTS + 1)]
    assert connections[-1].recv(10) == b"" and server.counts["turned_away"] == 1
    for connection in connections:
        connection.close()


def order(connection, **content):
    connection.sendall(json.dumps(content).encode() + b"\n")


def test_orders_and_answers(server):
    client = listener(server)
    order(client, order="arm", number=3)
    orders = []
    for piece in (b'{"order"', b': "si', b'ng"}\n{"or'):
        client.sendall(piece)
        orders += server.poll()
    orders += until(server, lambda: server.counts["orders"] == 2)
    assert [one.content for one in orders] == [{"order": "arm", "number": 3}, {"order": "sing"}]
    server.answer(orders[1], "no such order")
    assert heard(client, 2)[1:] == [{"answer": "sing", "ok": False, "error": "no such order"}]
    client.close()


@pytest.mark.parametrize(
    "content",
    [
        b"GET / HTTP/1.1\r\nHost: x\r\n\r\n",
        b"POST / HTTP/1.1\r\n\r\n" + b'{"order": "estop"}\n',
        b"[1, 2]\n",
        b"\n",
        b'{"order": ' + b"[" * 900 + b"\n",
        b"x" * (LONGEST_LINE + 1),
        bytes(range(256)) + b"\n",
    ],
)
def test_what_is_no_order_ends_the_connection(server, content):
    client = listener(server)
    client.sendall(content)
    assert until(server, lambda: server.counts["garbled"] == 1) == [] and server.listeners == []
    heard(client, 1)
    assert client.recv(10) == b""
    client.close()


@pytest.mark.parametrize(
    ("token", "given", "allowed"),
    [
        (None, {}, False),
        (None, {"token": None}, False),
        ("secret", {}, False),
        ("secret", {"token": "Secret"}, False),
        ("secret", {"token": "\ud800"}, False),
        ("secret", {"token": ["secret"]}, False),
        ("secret", {"token": "secret"}, True),
    ],
)
def test_from_another_machine_only_with_the_token(token, given, allowed):
    server = JointServer(GREETING, "127.0.0.1", 0, token)
    client = listener(server)
    server.listeners[0].local = False  # as if it were not on this machine
    order(client, order="estop", **given)
    orders = until(server, lambda: server.counts["orders"] + server.counts["orders_refused"])
    assert bool(orders) == allowed
    if not allowed:
        answer = heard(client, 2)[1]
        assert (answer["ok"], answer["answer"]) == (False, "estop") and "token" in answer["error"]
    client.close()
    server.close()


def test_a_port_that_is_taken(server):
    host, port = server.address
    assert host == "127.0.0.1"
    with pytest.raises(UserError, match=rf"TCP 127.0.0.1:{port} cannot be opened.*another port"):
        JointServer(GREETING, "127.0.0.1", port)
