"""Captures of the network: files written byte by byte from their formats' descriptions, on every
link that is read.
"""

import importlib.util
import struct

import numpy as np
import pytest
from test_packet_file import table

from ravenjax.store.motion import packet_file

HERE, THERE = bytes([10, 0, 0, 1]), bytes([10, 0, 0, 2])
needs_dpkt = pytest.mark.skipif(
    importlib.util.find_spec("dpkt") is None, reason="the package dpkt is not installed"
)
BEGIN_NS = 1_700_000_000_000_000_000


def ipv4(content, port=36000, sender=5000):
    udp = struct.pack(">HHHH", sender, port, 8 + len(content), 0) + content
    return struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 1, 0, 64, 17, 0, HERE, THERE) + udp


def ipv6(content):
    udp = struct.pack(">HHHH", 5000, 36000, 8 + len(content), 1) + content
    return (
        struct.pack(">IHBB16s16s", 6 << 28, len(udp), 17, 64, bytes(15) + b"\1", bytes(15) + b"\2")
        + udp
    )


LINKS = {
    "ethernet": (1, lambda packet: bytes(12) + b"\x08\x00" + packet),
    "vlan": (1, lambda packet: bytes(12) + b"\x81\x00\x00\x07\x08\x00" + packet),
    "linux cooked": (
        113,
        lambda packet: struct.pack(">HHH8sH", 0, 1, 6, bytes(8), 0x0800) + packet,
    ),
    "linux cooked 2": (
        276,
        lambda packet: struct.pack(">HHIHBB8s", 0x0800, 0, 1, 1, 0, 6, bytes(8)) + packet,
    ),
    "loopback": (0, lambda packet: struct.pack("<I", 2) + packet),
    "plain": (101, lambda packet: packet),
}


def pcap(path, frames, link=1):
    """frames: (ns since the epoch, content)."""
    with open(path, "wb") as file:
        file.write(struct.pack("<IHHiIII", 0xA1B23C4D, 2, 4, 0, 0, 1 << 16, link))
        for ns, content in frames:
            file.write(
                struct.pack("<IIII", ns // 10**9, ns % 10**9, len(content), len(content)) + content
            )
    return path


def pcapng(path, frames):
    def block(kind, content):
        content += bytes(-len(content) % 4)
        length = 12 + len(content)
        return struct.pack("<II", kind, length) + content + struct.pack("<I", length)

    with open(path, "wb") as file:
        file.write(block(0x0A0D0D0A, struct.pack("<IHHq", 0x1A2B3C4D, 1, 0, -1)))
        file.write(
            block(1, struct.pack("<HHI", 1, 0, 1 << 16) + struct.pack("<HHB3xHH", 9, 1, 9, 0, 0))
        )
        for ns, content in frames:
            head = struct.pack("<IIIII", 0, ns >> 32, ns & (2**32 - 1), len(content), len(content))
            file.write(block(6, head + content))
    return path


@pytest.fixture
def datagrams(tmp_path):
    return packet_file.read_packets(table(tmp_path / "packets.parquet")).datagrams


def timed(contents, step_ns=1_000_000):
    return [(BEGIN_NS + n * step_ns, one) for n, one in enumerate(contents)]


@needs_dpkt
@pytest.mark.parametrize("name", LINKS)
def test_every_link_gives_the_datagrams_and_their_times(tmp_path, datagrams, name):
    number, framed = LINKS[name]
    packets = packet_file.read_packets(
        pcap(tmp_path / "a.pcap", timed(framed(ipv4(one)) for one in datagrams), number)
    )
    assert packets.datagrams == datagrams
    np.testing.assert_allclose(packets.time, np.arange(50) * 1e-3, atol=1e-6)


@needs_dpkt
def test_ipv6_and_the_newer_format(tmp_path, datagrams):
    frames = timed(bytes(12) + b"\x86\xdd" + ipv6(one) for one in datagrams)
    packets = packet_file.read_packets(pcapng(tmp_path / "a.pcapng", frames))
    assert packets.datagrams == datagrams
    np.testing.assert_allclose(np.diff(packets.time), 1e-3, atol=1e-6)


@needs_dpkt
def test_other_traffic_is_left_out_and_a_second_sender_told(tmp_path, datagrams):
    framed = LINKS["ethernet"][1]
    others = [
        framed(ipv4(bytes(52), port=5000, sender=36000)),
        framed(ipv4(bytes(500), port=53)),
        b"\1\2",
        bytes(60),
    ]
    frames = [frame for one in datagrams for frame in (framed(ipv4(one)), *others)]
    frames += [framed(ipv4(datagrams[0], sender=7))]
    packets = packet_file.read_packets(pcap(tmp_path / "a.pcap", timed(frames)))
    assert packets.datagrams == datagrams
    assert packets.notes == ("1 packets of 1 other senders to port 36000 are left out",)
