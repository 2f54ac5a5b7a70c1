"""Reads a console's packets in a capture of the network (.pcap, .pcapng), as tcpdump and Wireshark
write it.

A console's packets are UDP datagrams of at least 124 bytes to port 36000; where nothing goes there,
to the one port that gets datagrams of that size. Of several senders the one that sent most is the
console.
"""

from __future__ import annotations

import importlib.util
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from ravenjax.errors import UserError
from ravenjax.robots.raven2.console.packet import U_STRUCT, UDP_PORT

SUFFIXES = (".pcap", ".pcapng")
INSTALL = "pip install 'ravenjax[pcap]'"


class Datagram(NamedTuple):
    """One datagram of UDP."""

    time_s: float  # since the epoch
    source: tuple[bytes, int]  # address and port
    port: int  # it went to
    content: bytes


def read(path: Path) -> tuple[list[bytes], np.ndarray, tuple[str, ...]]:
    """The console's datagrams, when each was captured in s [T], and what a user should know.
    UserError.
    """
    datagrams = [one for one in _datagrams(path) if len(one.content) >= U_STRUCT.itemsize]
    ports = Counter(one.port for one in datagrams)
    if not datagrams or (UDP_PORT not in ports and len(ports) > 1):
        there = (
            ", ".join(f"{count} to port {port}" for port, count in ports.most_common(4)) or "none"
        )
        raise UserError(
            f"{path}: expected a console's packets, UDP datagrams of {U_STRUCT.itemsize} bytes or"
            f" more to port {UDP_PORT} or to one other port; got {there}"
        )
    port = UDP_PORT if UDP_PORT in ports else next(iter(ports))
    senders = Counter(one.source for one in datagrams if one.port == port)
    (console, _), *others = senders.most_common()
    stream = [one for one in datagrams if one.port == port and one.source == console]
    more = sum(count for _, count in others)
    notes = (
        (f"{more} packets of {len(others)} other senders to port {port} are left out",)
        if others
        else ()
    )
    return [one.content for one in stream], np.array([one.time_s for one in stream]), notes


def _datagrams(path: Path) -> Iterator[Datagram]:
    if importlib.util.find_spec("dpkt") is None:
        raise UserError(
            f"{path}: a capture is read by the package dpkt, which is not installed: {INSTALL}"
        )
    import dpkt

    try:
        with open(path, "rb") as file:
            reader = dpkt.pcap.UniversalReader(file)
            link = _links(dpkt).get(reader.datalink())
            if link is None:
                raise UserError(
                    f"{path}: captured on a link of type {reader.datalink()}, which is not known"
                    " here; expected Ethernet, Linux 'any', loopback or plain IP. Capture with"
                    " tcpdump -i eth0"
                )
            yield from _of_frames(dpkt, link, reader)
    except (OSError, ValueError, struct.error, dpkt.UnpackError) as error:
        raise UserError(
            f"{path}: no capture that can be read: {str(error) or type(error).__name__}"
        ) from None


def _links(dpkt: Any) -> dict[int, Any]:
    """What reads a frame, by the type of the link."""
    from dpkt import loopback, sll, sll2

    pcap = dpkt.pcap
    return {
        pcap.DLT_EN10MB: dpkt.ethernet.Ethernet,
        pcap.DLT_LINUX_SLL: sll.SLL,
        pcap.DLT_LINUX_SLL2: sll2.SLL2,
        pcap.DLT_NULL: loopback.Loopback,
        pcap.DLT_LOOP: loopback.Loopback,
        pcap.DLT_RAW: _ip,
        101: _ip,  # LINKTYPE_RAW, which files have
        pcap.DLT_IPV4: _ip,
        pcap.DLT_IPV6: _ip,
    }


def _ip(content: bytes) -> Any:
    """A frame that is a packet of IP."""
    from dpkt import ip, ip6

    return ip6.IP6(content) if content[:1] and content[0] >> 4 == 6 else ip.IP(content)


def _of_frames(dpkt: Any, link: Any, reader: Any) -> Iterator[Datagram]:
    """The datagrams among frames, in their order; a capture may end within a frame where it was
    stopped.
    """
    frames = iter(reader)
    while True:
        try:
            time_s, content = next(frames)
        except (StopIteration, dpkt.NeedData):
            return
        try:
            packet = link(content)
        except (
            dpkt.UnpackError,
            struct.error,
            IndexError,
            ValueError,
        ):  # of another protocol, or cut
            continue
        while packet is not None and not isinstance(packet, (dpkt.ip.IP, dpkt.ip6.IP6)):
            packet = getattr(packet, "data", None)
            if isinstance(packet, bytes):
                packet = None
        if packet is not None and isinstance(packet.data, dpkt.udp.UDP):
            udp = packet.data
            yield Datagram(float(time_s), (packet.src, udp.sport), udp.dport, bytes(udp.data))
