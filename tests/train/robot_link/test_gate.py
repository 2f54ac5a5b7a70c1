"""The packet filter: every rule."""

import math
import struct

import jax.numpy as jnp
import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from itp_client import IDENTITY, datagram

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import network
from ravenjax.store import consoles
from ravenjax.train.robot_link.itp import CAUSES, TAKEN, Gate


def turned(angle):
    return (math.sin(angle / 2), 0.0, 0.0, math.cos(angle / 2))


CONSOLE, OTHER = ("127.0.0.1", 40000), ("127.0.0.1", 40001)
BOTH = ("gold", "green")


def sent(gate, *numbers, source=CONSOLE, now_ms=0.0, **fields):
    """Packets with these numbers; what became of the last one."""
    before = dict(gate.counts)
    for number in numbers:
        gate.admit(datagram(number, **fields), source, now_ms)
    changed = [cause for cause in CAUSES if gate.counts[cause] != before[cause]]
    return changed[-1] if len(changed) == 1 else changed


def test_everything_in_a_packet_comes_through():
    quats = (0.0, 0.0, math.sin(0.02), math.cos(0.02)), (math.sin(-0.01), 0.0, 0.0, math.cos(0.01))
    got = Gate(BOTH).admit(
        datagram(1, gold=(1, -2, 3), green=(-40, 50, -60), quats=quats, grasp=(9, -8)), CONSOLE, 0
    )
    assert got is not None
    assert got["pedal"] and got["arms"] == {
        "gold": {"delta_um": [1, -2, 3], "quat": list(quats[0]), "grasp_mrad": 9},
        "green": {"delta_um": [-40, 50, -60], "quat": list(quats[1]), "grasp_mrad": -8},
    }


def test_two_consoles_on_one_stream_are_reported_once():
    said: list[str] = []
    gate = Gate(BOTH, say=said.append)
    for number in range(1, 1001):
        sent(gate, number)
        sent(gate, 500_000 + number)
    (dropped,) = [line for line in said if "dropped" in line]
    assert "two consoles send" in dropped


def test_longer_is_cut_and_shorter_dropped():
    gate = Gate(BOTH)
    assert gate.admit(datagram(1) + b"more", CONSOLE, 0) is not None
    assert gate.admit(datagram(2)[:123], CONSOLE, 0) is None
    assert gate.admit(b"", CONSOLE, 0) is None
    assert (gate.counts["short"], gate.received) == (2, 3)


@pytest.mark.parametrize(
    ("fields", "cause"),
    [
        ({"gold": (1000, 0, 0)}, TAKEN),
        ({"gold": (1000, 1, 0)}, "step"),
        ({"green": (-(2**31), 0, 0)}, "step"),
        ({"quats": (turned(0.0999), IDENTITY)}, TAKEN),
        ({"quats": (turned(0.1001), IDENTITY)}, "turn"),
        (
            {"quats": (IDENTITY, tuple(-x for x in turned(-0.0999)))},
            TAKEN,
        ),  # the other sign is the same turn
        ({"quats": ((0.0, 0.0, 0.0, 0.0), IDENTITY)}, "quaternion"),
        ({"quats": (IDENTITY, (0.0, 0.0, 0.0, 1.02))}, "quaternion"),
        ({"quats": (IDENTITY, (math.nan, 0.0, 0.0, 1.0))}, "quaternion"),
        ({"quats": ((0.0, -math.inf, 0.0, 1.0), IDENTITY)}, "quaternion"),
        ({"quats": ((0.0, 1e300, 0.0, 1.0), IDENTITY)}, "quaternion"),
        ({"grasp": (200, -200)}, TAKEN),
        ({"grasp": (0, -201)}, "grasp"),
        ({"surgeon_mode": 0}, TAKEN),
        ({"surgeon_mode": 2}, "mode"),
        ({"surgeon_mode": -1}, "mode"),
    ],
)
def test_content(fields, cause):
    gate = Gate(BOTH)
    assert sent(gate, 1, **fields) == cause
    assert sent(gate, 1) == ("duplicate" if cause == TAKEN else TAKEN), (
        "what is refused was never there"
    )


def test_numbers():
    gate = Gate(BOTH)
    assert sent(gate, 0) == "zero"
    assert sent(gate, 5) == "skip", "a stream that starts elsewhere loses its first packet"
    assert sent(gate, 6) == TAKEN
    assert sent(gate, 6) == "duplicate"
    assert sent(gate, 8) == "skip"
    assert sent(gate, 7) == "behind"
    assert sent(gate, 9) == TAKEN
    assert sent(gate, 9 + 1000) == "skip"
    assert sent(gate, 1009 + 1001) == "far_ahead"
    assert sent(gate, 1010) == TAKEN
    assert sent(gate, 2) == "behind", "the robot would take this for a restart"
    assert sent(gate, 1011) == TAKEN


def test_numbers_go_round_without_the_reserved_one():
    gate = Gate(BOTH)
    assert sent(gate, 2**32 - 2) == "skip"
    assert sent(gate, 2**32 - 1) == TAKEN
    assert sent(gate, 1) == TAKEN


def test_restart_at_one_only_by_a_quiet_console():
    gate = Gate(BOTH)
    sent(gate, 1, 2, 3)
    assert sent(gate, 1, now_ms=250.0) == "behind"
    assert sent(gate, 1, now_ms=250.1) == "restart"
    assert sent(gate, 4, now_ms=250.2) == "skip"
    assert sent(gate, 2, now_ms=250.3) == "behind"


def test_one_console_until_it_is_silent():
    gate = Gate(BOTH)
    assert sent(gate, 1) == TAKEN
    assert sent(gate, 2, source=OTHER) == "stranger"
    assert sent(gate, 2, now_ms=1999.0) == TAKEN
    assert sent(gate, 1, source=OTHER, now_ms=3999.0) == "stranger"
    assert gate.peer(3999.0) == CONSOLE
    assert sent(gate, 1, source=OTHER, now_ms=3999.1) == TAKEN
    assert gate.peer(3999.1) == OTHER
    assert sent(gate, 3, now_ms=3999.2) == "stranger"
    assert gate.peer(9999.0) is None


@settings(max_examples=15, deadline=None)
@given(st.lists(st.integers(0, 2200), min_size=1, max_size=6), st.integers(1, 1100))
def test_takes_nothing_that_the_robot_would_drop(numbers, first):
    """The rules of `stages.network`, run beside, on streams without pauses: the gate is only
    ever stricter.
    """
    setup, gate = RavenSetup(arms=BOTH, tools=("r_grasper",) * 2), Gate(BOTH)
    state = network.init(setup)
    zero = Packet(
        1, np.int32(124), np.int32(0), (Vec.full(3, 0),) * 2, (Vec.full(4, 0.0),) * 2, (0, 0), 1
    )
    for number in (first, first + 1, *(first + n - 1100 for n in numbers)):
        cause = sent(gate, max(number, 0))
        if cause in (TAKEN, "skip"):  # what does not count for the gate does not reach the robot
            packet = Packet(**(vars(zero) | {"sequence": jnp.int32(max(number, 0))}))
            state, accepted = network.step(setup, state, np.int32(0), packet)
            assert bool(accepted) == (cause == TAKEN)


@given(st.binary(min_size=124, max_size=130), st.integers(0, 1))
def test_what_is_taken_is_within_limits(content, mode):
    """Any bits for numbers, but with a valid number and pedal, so that many reach the last
    rules.
    """
    content = struct.pack("<I", 1) + content[4:116] + struct.pack("<i", mode) + content[120:]
    checksum = (
        sum(struct.unpack_from("<6i", content, 12))
        + sum(struct.unpack_from("<2i", content, 100))
        + mode
        + 1
    )
    content = content[:120] + struct.pack("<I", checksum & 0xFFFFFFFF) + content[124:]
    gate = Gate(BOTH)
    got = gate.admit(content, CONSOLE, 0.0)
    assert (got is not None) == (gate.counts[TAKEN] == 1)
    if got is not None:
        assert all(math.hypot(*arm["delta_um"]) <= 1000 for arm in got["arms"].values())
        assert all(abs(math.hypot(*arm["quat"]) - 1) < 0.011 for arm in got["arms"].values())


# --- profiles ---


def test_under_a_wrong_profile_a_message_names_the_right_one_once(shared_data):
    packets = pd.read_parquet(shared_data("console_itp_packets.parquet"))["packet"].iloc[
        10_000:11_000
    ]
    told = []
    gate = Gate(BOTH, say=told.append)
    for packet in packets:
        gate.admit(packet, CONSOLE, 0.0)
    (line,) = told
    assert "do not fit profile raven" in line
    assert line.endswith("start again with --console dv_trainer")


def test_a_choice_is_said_and_outlives_its_console():
    told = []
    gate = Gate(BOTH, profiles=consoles.profile_choices("auto"), say=told.append)
    turn = (0.0, math.sin(0.02), 0.0, math.cos(0.02))
    assert sent(gate, 1) == TAKEN
    assert sent(gate, 2, quats=(turn, IDENTITY)) == "undecided"
    assert told == [] and gate.profile is None
    sent(gate, 3, 4, 5, quats=(turn, IDENTITY))
    assert sent(gate, 6, quats=(turn, IDENTITY)) == TAKEN
    assert gate.profile == consoles.load_profile("raven")
    (line,) = told
    assert line.startswith("console: profile raven, ") and "Not profile dv_trainer: 4 of" in line
    assert gate.peer(9999.0) is None
    assert sent(gate, 1, quats=((0.0, 1.0, 0.0, 1.0), IDENTITY), now_ms=9999.0) == "quaternion", (
        "it never switches"
    )
