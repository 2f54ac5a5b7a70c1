"""Recorded packets sent again: byte by byte, in their order, with the pedal up ahead of them."""

import socket
import threading

import numpy as np
import pandas as pd
import pytest
import waiting
from itp_client import datagram

from ravenjax.cli import USER_ERROR, main
from ravenjax.store import consoles
from ravenjax.train.robot_link import itp, player
from ravenjax.train.robot_link.itp import TAKEN, Gate, ItpServer

BOTH = ("gold", "green")


def recorded(first=1, count=40):
    return [datagram(first + n, gold=(3, 0, -1), green=(0, 2, 0)) for n in range(count)]


@pytest.fixture
def ear():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as port:
        port.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        port.bind(("127.0.0.1", 0))
        port.settimeout(waiting.DEADLINE_S)
        yield port


@pytest.mark.parametrize("first", [1, 90, 20468, 2**32 - 5])
def test_ahead_goes_what_moves_nothing_with_the_pedal_up(first):
    packets = recorded(first, 3)
    gate = Gate(BOTH)
    asked = [
        gate.admit(one, ("h", 1), float(n))
        for n, one in enumerate([*player.lead_packets(packets[0]), *packets])
    ]
    assert gate.counts[TAKEN] == len(asked) - 1, "only the first of all is lost, as of any stream"
    ahead, own = asked[1:-3], asked[-3:]
    still = {"delta_um": [0, 0, 0], "quat": [0.0, 0.0, 0.0, 1.0], "grasp_mrad": 0}
    assert all(one["pedal"] == 0 and one["arms"]["gold"] == still for one in ahead)
    assert all(one["pedal"] for one in own) and own[0]["arms"]["green"]["delta_um"] == [0, 2, 0]


def test_what_was_recorded_arrives_in_its_order_and_takes_its_time(ear, monkeypatch):
    monkeypatch.setattr(player, "REPEAT_S", 0.01)
    packets = recorded()
    told = player.play_packets(packets, np.arange(40) * 5e-3, ear.getsockname(), lambda _: None)
    heard = [ear.recv(2048) for _ in range(player.LEAD_COUNT + 40)]
    assert heard[-40:] == packets
    assert told[:2] == (40, 40) and told.seconds >= 39 * 5e-3
    assert "check that a robot listens at this address" in str(told)


def test_a_second_play_waits_until_the_first_is_let_go(monkeypatch):
    """Where nobody follows the first packets, the pedal would never be seen up: the recording
    has it down.
    """
    monkeypatch.setattr(itp, "RELEASE_MS", 400)
    server, stop, counted = ItpServer(Gate(BOTH), port=0), threading.Event(), []

    def robot():
        while not stop.wait(1e-3):
            counted.extend(command["pedal"] for command in server.poll())
            server.send_force({})

    thread = threading.Thread(target=robot)
    thread.start()
    for _ in range(2):
        player.play_packets(recorded(20468), np.arange(40) * 2e-3, server.address, lambda _: None)
    stop.set()
    thread.join()
    downs = [i for i, pedal in enumerate(counted) if pedal]
    ups = [i for i, pedal in enumerate(counted) if not pedal]
    assert server.gate.counts["stranger"] > 0, "the second came while the first was followed"
    assert server.gate.counts[TAKEN] > 300 and ups[0] < downs[0]
    assert [i for i in ups if i > downs[0]], (
        "the pedal of the second was seen up before it was down"
    )
    server.close()


def test_a_file_is_played_by_command(ear, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(player, "REPEAT_S", 0.01)
    frame = pd.DataFrame({"packet": recorded(), "arrival_ms": np.arange(40) * 1.0})
    frame.to_parquet(tmp_path / "packets.parquet")
    address = "{}:{}".format(*ear.getsockname())
    assert (
        main(["play", str(tmp_path / "packets.parquet"), "--to", address, "--console", "raven"])
        == 0
    )
    assert "40 of 40 packets sent" in capsys.readouterr().out
    assert main(["play", str(tmp_path / "packets.parquet"), "--to", "nowhere"]) == USER_ERROR


def test_the_recorded_console_is_taken_whole(shared_data):
    """Halves, single arms and pieces of the recording, at the times at which their packets came."""
    rows = pd.read_parquet(shared_data("console_itp_packets.parquet"))
    packets, ms = list(rows["packet"]), rows["arrival_us"].to_numpy() * 1e-6
    half = len(packets) // 2
    for begin, end in ((0, half), (half, len(packets)), (5000, 6000), (15900, 16600)):
        for arms in (BOTH, ("gold",), ("green",)):
            gate = Gate(arms, profiles=consoles.profile_choices("dv_trainer"))
            for packet, at in zip(packets[begin:end], ms[begin:end], strict=True):
                gate.admit(packet, ("h", 1), at)
            assert gate.counts[TAKEN] >= 0.998 * (end - begin)
