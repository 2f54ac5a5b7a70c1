"""Reads a recorded stream of a console's packets as a motion of the operator's hands.

A packet contains an increment of the tip's pose. The motion adds the increments to the homed pose.

A table (Parquet) has a column `packet` (124 bytes each) and a column of arrival times. A network
capture (.pcap, .pcapng), as tcpdump and Wireshark write it, contains both. A console's packets are
UDP datagrams of at least 124 bytes to port 36000, or else to the only port that receives datagrams
of that size. If there are several senders, the console is the one that sent most.

Packets are read with the console's profile. As in the robot, a packet moves nothing if its sequence
number is repeated or smaller, or comes after a gap. The numbers may start again at 1.
"""

from __future__ import annotations

import contextlib
import importlib.util
import math
import struct
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np

from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import ARMS, ArmName
from ravenjax.robots.raven2.console.choice import UNDECIDED, ProfileChoice, matching_profile
from ravenjax.robots.raven2.console.packet import UDP_PORT
from ravenjax.robots.raven2.console.profile import ConsoleProfile
from ravenjax.robots.raven2.console.reading import FIELDS, MODE, Misfit, PacketReader, PacketReading
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.robots.raven2.stages.network import RESET_GAP
from ravenjax.store import consoles, files
from ravenjax.store.logs.topics import continuous_turns
from ravenjax.store.motion import stamps
from ravenjax.store.motion.track import ArmTrack, Home, Track
from ravenjax.vocabulary.packets import (
    MOST_CYCLES,
    QUIET_MS,
    RELEASE_MS,
    packet_lengths,
    rounded_shares,
)

if TYPE_CHECKING:
    import pandas as pd

CAPTURES = (".pcap", ".pcapng")
INSTALL = "pip install 'ravenjax[pcap]'"
PACKET, ARRIVAL = "packet", "arrival"
MOST_MISFITS = 0.02
"""Largest share of packets that may not fit the profile; more come from another console."""
RATE_AGREES = 3.0
"""Largest factor between the rate at which packets arrived and the profile's rate."""


class PacketStream(NamedTuple):
    """A recorded packet stream after decoding: T packets that command A arms."""

    profile: ConsoleProfile
    # [T, A, 3] commanded tip increments along the ITP axes; 0 for packets that the robot ignores.
    delta_um: np.ndarray
    quat: np.ndarray  # [T, A, 4] commanded rotation about the ITP axes
    grasp_mrad: np.ndarray  # [T, A] change of the grasp, positive closes
    # [T] 0 up or 1 down; a packet that the robot ignores keeps the value before it.
    pedal: np.ndarray
    accepted: np.ndarray  # bool [T], whether the robot executes the packet
    packets: RawPackets  # undecoded packets with arrival times, s


class RawPackets(NamedTuple):
    """The packets of a recording, not yet decoded."""

    datagrams: list[bytes]  # 124 bytes or more each
    time: np.ndarray  # [T] time since the first packet, in the unit of the time column
    clock: str  # name of the time column; "" for a capture
    notes: tuple[str, ...] = ()

    @property
    def fields(self) -> list[tuple]:
        """Decoded fields of each packet."""
        return [FIELDS.unpack_from(datagram) for datagram in self.datagrams]


def read_packets(path: Path) -> RawPackets:
    """Return datagrams and arrival times of a Parquet file or a network capture. Raise UserError if
    the file is damaged or contains no packet stream.
    """
    capture = path.suffix.lower() in CAPTURES
    packets = _read_capture(path) if capture else _read_table(path, files.read_table(path))
    if len(packets.datagrams) < 2:
        raise UserError(f"{path}: contains {len(packets.datagrams)} packets; expected at least 2")
    since = stamps.times_since_first(packets.time)
    if not np.isfinite(since).all() or (np.diff(since) < 0).any() or since[-1] <= 0:
        raise UserError(
            f"{path}: {f'column {packets.clock}' if packets.clock else 'times of the capture'} must"
            " be finite and must not decrease, and the last must be later than the first"
        )
    return packets._replace(time=since)


def _read_table(path: Path, table: pd.DataFrame) -> RawPackets:
    # Reads packets from a table with a column of datagrams and a column of arrival times.
    names = [
        name
        for name in stamps.time_columns(table, (ARRIVAL, *stamps.NAMES))
        if table[name].dtype.kind in "iuf"
    ]
    if PACKET not in table or len(names) != 1:
        raise UserError(
            f"{path}: expected a column {PACKET}, and one column {ARRIVAL}_s (or _ms, _us, _ns)"
            f" with the arrival times of the packets; got {', '.join(map(str, table)) or 'none'}"
        )
    datagrams = table[PACKET].tolist()
    for row, datagram in enumerate(datagrams):
        if not isinstance(datagram, bytes) or len(datagram) < FIELDS.size:
            raise UserError(
                f"{path}: row {row}, column {PACKET}: expected {FIELDS.size} bytes or more in"
                " each row"
            )
    return RawPackets(datagrams, table[names[0]].to_numpy(), names[0])


class Datagram(NamedTuple):
    """One UDP datagram."""

    time_s: float  # since the epoch
    sender: tuple[bytes, int]  # address and port
    port: int  # destination
    content: bytes


def _read_capture(path: Path) -> RawPackets:
    # Reads the packets of one console, the most frequent sender, from a network capture.
    datagrams = [datagram for datagram in _datagrams(path) if len(datagram.content) >= FIELDS.size]
    ports = Counter(datagram.port for datagram in datagrams)
    if not datagrams or (UDP_PORT not in ports and len(ports) > 1):
        there = ", ".join(f"{count} to port {port}" for port, count in ports.most_common(4))
        raise UserError(
            f"{path}: expected packets of a console, UDP datagrams of {FIELDS.size} bytes or more."
            f" If none goes to port {UDP_PORT}, all must go to the same port; got {there or 'none'}"
        )
    port = UDP_PORT if UDP_PORT in ports else next(iter(ports))
    to_port = [datagram for datagram in datagrams if datagram.port == port]
    (console, _), *others = Counter(datagram.sender for datagram in to_port).most_common()
    stream = [datagram for datagram in to_port if datagram.sender == console]
    more = sum(count for _, count in others)
    note = f"{more} packets of {len(others)} other senders to port {port} are left out"
    return RawPackets(
        [datagram.content for datagram in stream],
        np.array([datagram.time_s for datagram in stream]),
        "",
        (note,) if others else (),
    )


def _datagrams(path: Path) -> Iterator[Datagram]:
    if importlib.util.find_spec("dpkt") is None:
        raise UserError(f"{path}: reading a network capture needs the package dpkt: {INSTALL}")
    import dpkt
    from dpkt import ip, ip6, loopback, pcap, sll, sll2

    def plain(content: bytes):
        return ip6.IP6(content) if content[:1] and content[0] >> 4 == 6 else ip.IP(content)

    links: dict[int, Any] = {
        pcap.DLT_EN10MB: dpkt.ethernet.Ethernet,
        pcap.DLT_LINUX_SLL: sll.SLL,
        pcap.DLT_LINUX_SLL2: sll2.SLL2,
        **dict.fromkeys((pcap.DLT_NULL, pcap.DLT_LOOP), loopback.Loopback),
        # Capture files use number 101 for what the library calls DLT_RAW.
        **dict.fromkeys((pcap.DLT_RAW, 101, pcap.DLT_IPV4, pcap.DLT_IPV6), plain),
    }
    not_of_udp = dpkt.UnpackError, struct.error, IndexError, ValueError
    try:
        with open(path, "rb") as file:
            reader = pcap.UniversalReader(file)
            if reader.datalink() not in links:
                raise UserError(
                    f"{path}: link type {reader.datalink()} of this capture is not supported;"
                    " expected Ethernet, Linux 'any', loopback or plain IP. Capture with"
                    " tcpdump -i eth0"
                )
            # A capture may be cut short.
            with contextlib.suppress(dpkt.NeedData):
                for time_s, content in reader:
                    try:
                        packet: Any = links[reader.datalink()](content)
                    except not_of_udp:
                        continue
                    while not isinstance(packet, (bytes, type(None), ip.IP, ip6.IP6)):
                        packet = getattr(packet, "data", None)
                    if isinstance(getattr(packet, "data", None), dpkt.udp.UDP):
                        found = cast("Any", packet)
                        udp, sender = found.data, (found.src, found.data.sport)
                        yield Datagram(float(time_s), sender, udp.dport, bytes(udp.data))
    except (OSError, *not_of_udp) as error:
        raise UserError(
            f"{path}: not a readable network capture: {str(error) or type(error).__name__}"
        ) from None


def time_packets(
    path: Path, console: str, arms: tuple[ArmName, ...] = ARMS
) -> tuple[RawPackets, ConsoleProfile]:
    """Return packets with their arrival times in seconds, and the console profile that fits them.
    Raise UserError if no profile fits.
    """
    packets = read_packets(path)
    profile = _profile(path, packets.fields, arms, console)
    return _in_seconds(path, packets, profile), profile


def read_track(
    path: Path, arms: tuple[ArmName, ...], console: str, home: dict[ArmName, Home]
) -> Track:
    """Return the tip poses that a packet stream commands. home: start pose of each arm."""
    read = read_stream(path, arms, console)
    rows, dropped = len(read.accepted), int((~read.accepted).sum())
    if dropped > MOST_MISFITS * rows:
        numbers = [fields[0] for fields in read.packets.fields]
        decreases = np.flatnonzero(np.diff(numbers) <= 0)
        cause = "Packets before them are missing. Record on the robot's computer or network"
        if decreases.size > MOST_MISFITS * rows:
            cause = (
                f"Packet numbers repeat or decrease {decreases.size} times, because two streams are"
                " mixed, or because each packet was recorded twice. Record one console, once"
            )
        elif decreases.size:
            cause = f"Packet numbers decrease after packet {decreases[0]}. Cut the file there"
        raise UserError(f"{path}: the robot would drop {dropped:,} of {rows:,} packets. {cause}")
    tracks: dict[str, ArmTrack] = {}
    for i, arm in enumerate(arms):
        axes = np.array(ITP_AXES[arm], float)
        moved = np.cumsum(read.delta_um[:, i], axis=0) @ axes.T * 1e-6
        turns = np.concatenate([read.quat[:, i, :3] @ axes.T, read.quat[:, i, 3:]], axis=1)
        tracks[arm] = ArmTrack(
            read.packets.time,
            home[arm].position + moved,
            _accumulated(home[arm].quat, turns),
            home[arm].opening_mrad - np.cumsum(read.grasp_mrad[:, i]),
        )
    cycles = packet_lengths(read.packets.time * 1e3)
    shares = ", ".join(f"{share:g}" for share in rounded_shares(cycles))
    notes = (
        *read.packets.notes,
        f"packets are those of console {read.profile.name}; the robot would drop"
        f" {dropped:,} of {rows:,}",
        f"campaign.packets = [{shares}] makes packets last as long as these, up to {MOST_CYCLES}"
        " ms",
    )
    ignored = tuple(f"{PACKET} ({arm})" for arm in ARMS if arm not in arms)
    return Track(path, read.packets.clock, tracks, read.pedal, (PACKET,), ignored, notes)


def _profile(
    path: Path, fields: Sequence[Sequence], arms: tuple[ArmName, ...], console: str
) -> ConsoleProfile:
    # Returns the profile named by `console`, or for "auto" the one bundled profile that fits.
    profiles = consoles.profile_choices(console)
    choice = ProfileChoice(profiles, arms)
    for packet in fields:
        if choice.profile is not None:
            break
        result = choice.read(packet)
        if isinstance(result, PacketReading) or result.cause == UNDECIDED:
            choice.accept_packet()
    if choice.profile is not None:
        return choice.profile
    # The packets do not decide. The first profile counts whose rules at least 90 % of them follow.
    name = matching_profile(fields, profiles, arms)
    if not name:
        raise UserError(
            f"{path}: the packets fit no bundled console profile; write operator.console ="
            " 'FILE.toml' with a profile of that console"
        )
    return consoles.load_profile(name)


def _in_seconds(path: Path, packets: RawPackets, profile: ConsoleProfile) -> RawPackets:
    """Return packets with their arrival times in seconds, and a description of their clock. If the
    packets come at the profile's rate only in another unit than the column's, use this unit and add
    a note. Raise UserError if they come at this rate in no unit, or in several other units.
    """
    times, name = packets.time, packets.clock
    if not name:
        return packets._replace(clock="times of the capture")
    expected_hz, unit = profile.stream.rate_hz, name.rpartition("_")[2]
    # Without the longest 2 % of steps: a pause indicates no other unit. A single step stays.
    steps = np.sort(np.diff(times))[: math.floor(0.98 * (len(times) - 1)) or None]
    # A coarse clock may repeat times, so these steps may all be 0.
    usual_step = steps.mean() or times[-1] / len(times)
    agreeing = [
        other
        for other, unit_s in stamps.UNITS.items()
        if expected_hz / RATE_AGREES <= 1.0 / usual_step / unit_s <= expected_hz * RATE_AGREES
    ]
    mean_rate = (len(times) - 1) / times[-1]
    rates = {other: f"{mean_rate / unit_s:.4g}" for other, unit_s in stamps.UNITS.items()}
    notes: tuple[str, ...] = ()
    if unit not in agreeing:
        if len(agreeing) != 1:
            raise UserError(
                f"{path}: by column {name}, {rates[unit]} packets arrive per second, but console"
                f" {profile.name} sends {expected_hz:g}. Write the right unit into the column's"
                " name, or the rate into a console profile of your own"
            )
        notes = (
            f"column {name} is read in {agreeing[0]}, which gives {rates[agreeing[0]]} packets per"
            f" second; in {unit} it would be {rates[unit]}",
        )
        unit = agreeing[0]
    return packets._replace(time=times * stamps.UNITS[unit], clock=f"column {name}", notes=notes)


def read_stream(path: Path, arms: tuple[ArmName, ...], console: str) -> PacketStream:
    """Return the decoded packets of a Parquet file or a network capture. console: name or file of a
    console profile, or "auto". Raise UserError if the packets do not fit the profile.
    """
    packets, profile = time_packets(path, console, arms)
    fields, count = packets.fields, len(arms)
    rows = len(fields)
    no_motion = PacketReading(((0, 0, 0),) * count, ((0.0, 0.0, 0.0, 1.0),) * count, (0,) * count)
    # These are the values of packets that the robot ignores. The loop fills in the other packets.
    readings, pedal, accepted = [no_motion] * rows, np.zeros(rows), np.zeros(rows, bool)
    reader, pedal_down = PacketReader(profile, arms), 0.0
    misfits: list[tuple[Sequence, Misfit]] = []
    # Sequence number and time of the last packet that belongs to the stream.
    last, last_s = fields[0][0] - 1, 0.0
    for row, (packet, time_s) in enumerate(zip(fields, packets.time.tolist(), strict=True)):
        number = packet[0]
        is_next = number == last + 1
        restarts = number < last and _restarts(number, last, time_s - last_s)
        result = reader.read(packet, is_next and row > 0)
        if isinstance(result, Misfit):
            misfits.append((packet, result))
        elif number and (number > last or restarts):
            reader.accept_packet()
            last, last_s = number, time_s
            # The first packet after a gap or a restart belongs to the stream, but moves nothing.
            if is_next:
                readings[row], accepted[row] = result, True
                pedal_down = packet[MODE]
        pedal[row] = pedal_down
    if len(misfits) > MOST_MISFITS * rows:
        others = [other for other in consoles.bundled_profiles() if other != profile]
        fits = matching_profile([packet for packet, _ in misfits], others, arms)
        advice = "no bundled profile fits them"
        if fits:
            advice = f"they fit {fits}: write operator.console = '{fits}'"
        raise UserError(
            f"{path}: {len(misfits)} of {rows} packets do not fit console profile {profile.name};"
            f" {advice}. The last of these packets breaks the rule for {misfits[-1][1]}"
        )
    delta, quat, grasp = (np.array(column, float) for column in zip(*readings, strict=True))
    return PacketStream(profile, delta, quat, grasp, pedal, accepted, packets)


def _restarts(number: int, last: int, silence_s: float) -> bool:
    """Return whether a packet whose number is below the last one restarts the stream. The robot
    accepts a restart if the number is far below the last one. A recorded session accepts number 1
    after QUIET_MS without packets, and any number after RELEASE_MS.
    """
    far = last > RESET_GAP and number < last - RESET_GAP
    return number > 0 and (
        far or (number == 1 and silence_s * 1e3 > QUIET_MS) or silence_s * 1e3 > RELEASE_MS
    )


def _accumulated(quat: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return the orientations after each rotation in `turns` [T, 4], as unit quaternions [T, 4].
    quat: orientation before the first. Rotations multiply from the left, as on the robot.
    """
    from scipy.spatial.transform import Rotation

    orientations, current = np.empty((len(turns), 4)), Rotation.from_quat(quat)
    turning = np.flatnonzero(np.any(turns[:, :3] != 0.0, axis=1))
    begin = 0
    for row in turning.tolist():
        orientations[begin:row] = current.as_quat()
        current, begin = Rotation.from_quat(turns[row]) * current, row
    orientations[begin:] = current.as_quat()
    return continuous_turns(orientations)
