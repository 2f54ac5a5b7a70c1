"""Reads a recorded stream of a console's packets as a motion: its increments, summed up from where
homing ends.

A table (Parquet) has a column `packet` (124 bytes each) and one that says when each arrived; a
capture of the network has both by itself. Whole packets are read under the console's profile, in
their order. What the robot would drop moves nothing: repeated and older numbers, and the packet
after a gap. A stream may start anew, see `_restarts`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import ARMS, ArmName
from ravenjax.robots.raven2.console import arrivals as packet_lengths
from ravenjax.robots.raven2.console.choice import UNDECIDED, ProfileChoice, fitting
from ravenjax.robots.raven2.console.profile import ConsoleProfile
from ravenjax.robots.raven2.console.reading import FIELDS, MODE, Misfit, PacketReader, PacketReading
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.robots.raven2.stages.network import RESET_GAP
from ravenjax.store.consoles import loading
from ravenjax.store.motion import capture_file, stamps
from ravenjax.store.motion.track import ArmTrack, Track
from ravenjax.vocabulary.packets import MOST_CYCLES, QUIET_MS, RELEASE_MS

PACKET, ARRIVAL = "packet", "arrival"
MOST_MISFITS = 0.02
"""Of a recording: with more of them the profile is another console's."""
RATE_AGREES = 3.0
"""By so much the rate of arrivals may differ from the profile's."""
GAPS_IN, GAPS_LEAST = 50, 20
"""One step in so many may be a gap, of more than so few; their rate is that of the others."""


class Home(NamedTuple):
    """Where a tip begins, frame 0."""

    position: np.ndarray  # [3] m
    quat: np.ndarray  # [4] x, y, z, w
    opening_mrad: float


class PacketStream(NamedTuple):
    """A recorded stream, read."""

    profile: ConsoleProfile
    arrival_s: np.ndarray  # [T] since the first
    delta_um: np.ndarray  # [T, A, 3] about the ITP axes; 0 where a packet moves nothing
    quat: np.ndarray  # [T, A, 4] turn about the ITP axes
    grasp_mrad: np.ndarray  # [T, A] closing
    pedal: np.ndarray  # [T] 0 or 1, held where a packet does not count
    counted: np.ndarray  # bool [T]
    clock: str  # the column of arrivals
    notes: tuple[str, ...]


def holds_packets(names: Sequence[str]) -> bool:
    """Whether a table with these columns is a stream of packets."""
    return PACKET in names


class RawPackets(NamedTuple):
    """A recording as it is."""

    datagrams: list[bytes]  # 124 bytes or more each
    columns: dict[str, np.ndarray]  # of a table, but the packets
    captured_s: np.ndarray | None  # [T] of a capture
    notes: tuple[str, ...]


def raw(path: Path) -> RawPackets:
    """The datagrams of a Parquet file or a capture, unread. UserError."""
    if path.suffix.lower() in capture_file.SUFFIXES:
        datagrams, captured_s, notes = capture_file.read(path)
        packets = RawPackets(datagrams, {}, captured_s, notes)
    else:
        packets = _of_table(path)
    if len(packets.datagrams) < 2:
        raise UserError(
            f"{path}: holds {len(packets.datagrams)} packets; expected a stream of at least 2"
        )
    return packets


def stream(path: Path, arms: tuple[ArmName, ...], console: str) -> PacketStream:
    """The packets of a Parquet file or a capture. console: a profile of `store.consoles`, or
    "auto". UserError.
    """
    packets = raw(path)
    fields = [FIELDS.unpack_from(one) for one in packets.datagrams]
    profile = _profile(path, fields, arms, console)
    arrival_s, clock, notes = _arrivals(path, packets, profile)
    return _summed(path, profile, fields, arms, arrival_s, clock, notes)


def arrivals(
    path: Path, packets: RawPackets, console: str
) -> tuple[np.ndarray, str, tuple[str, ...]]:
    """Seconds of each packet since the first, what says so, and notes. UserError where no
    profile fits.
    """
    fields = [FIELDS.unpack_from(one) for one in packets.datagrams]
    return _arrivals(path, packets, _profile(path, fields, ARMS, console))


def _of_table(path: Path) -> RawPackets:
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise UserError(
            f"{path}: is no Parquet file, or not a whole one: {str(error).splitlines()[0]}."
            " Expected packets as .parquet, .pcap or .pcapng; copy one that was cut short again"
        ) from None
    datagrams = table[PACKET].to_pylist()
    short = next(
        (
            i
            for i, one in enumerate(datagrams)
            if not isinstance(one, bytes) or len(one) < FIELDS.size
        ),
        None,
    )
    if short is not None:
        raise UserError(
            f"{path}: row {short}, column {PACKET}: expected {FIELDS.size} bytes or more in"
            " each row"
        )
    columns = {name: table[name].to_numpy() for name in table.column_names if name != PACKET}
    return RawPackets(datagrams, columns, None, ())


def track(path: Path, arms: tuple[ArmName, ...], console: str, home: dict[ArmName, Home]) -> Track:
    """The tips that a stream asks for. home: where each arm begins."""
    read = stream(path, arms, console)
    tracks: dict[str, ArmTrack] = {}
    for i, arm in enumerate(arms):
        axes = np.array([[float(c) for c in row] for row in ITP_AXES[arm]])
        moved = np.cumsum(read.delta_um[:, i], axis=0) @ axes.T * 1e-6
        turns = np.concatenate([read.quat[:, i, :3] @ axes.T, read.quat[:, i, 3:]], axis=1)
        tracks[arm] = ArmTrack(
            read.arrival_s,
            home[arm].position + moved,
            _accumulated(home[arm].quat, turns),
            home[arm].opening_mrad - np.cumsum(read.grasp_mrad[:, i]),
        )
    lost = int((~read.counted).sum())
    cycles = packet_lengths.lengths(read.arrival_s * 1e3)
    shares = ", ".join(f"{share:g}" for share in packet_lengths.as_campaign(cycles))
    model = (
        f"campaign.packets = [{shares}] makes packets last as long as these, up to {MOST_CYCLES} ms"
    )
    note = (
        f"packets are those of console {read.profile.name}; the robot would drop {lost:,} of"
        f" {len(read.counted):,}"
    )
    others = tuple(arm for arm in ARMS if arm not in arms)
    return Track(
        path,
        read.clock,
        tracks,
        read.pedal,
        (PACKET,),
        tuple(f"{PACKET} ({arm})" for arm in others),
        (
            *read.notes,
            note,
            model,
        ),
    )


def _profile(
    path: Path, fields: Sequence[Sequence], arms: tuple[ArmName, ...], console: str
) -> ConsoleProfile:
    profiles = loading.choice(console)
    choice = ProfileChoice(profiles, arms)
    for packet in fields:
        if choice.profile is not None:
            return choice.profile
        result = choice.read(packet)
        if isinstance(result, PacketReading) or result.cause == UNDECIDED:
            choice.follow()
    if choice.profile is not None:
        return choice.profile
    fits = fitting(fields, profiles, arms)
    if not fits:
        raise UserError(
            f"{path}: the packets fit no bundled profile of a console; write operator.console ="
            " 'FILE.toml'"
        )
    return loading.load(fits)


def _arrivals(
    path: Path, packets: RawPackets, profile: ConsoleProfile
) -> tuple[np.ndarray, str, tuple[str, ...]]:
    if packets.captured_s is None:
        return _of_column(path, packets.columns, profile)
    since = packets.captured_s - packets.captured_s[0]
    if (np.diff(since) < 0).any() or since[-1] <= 0:
        raise UserError(
            f"{path}: times of the capture go back; bring it into their order: reordercap IN OUT"
        )
    return since, "times of the capture", packets.notes


def _of_column(
    path: Path, columns: dict[str, np.ndarray], profile: ConsoleProfile
) -> tuple[np.ndarray, str, tuple[str, ...]]:
    """Seconds since the first packet, the column, and a note where its unit is not what its name
    says.
    """
    suffixes = {word: unit for unit, (_, words) in stamps.UNITS.items() for word in words}
    names = [name for name in columns if name.rpartition("_")[0] in (ARRIVAL, *stamps.NAMES)]
    names = [
        name
        for name in names
        if name.rpartition("_")[2] in suffixes and columns[name].dtype.kind in "iuf"
    ]
    if len(names) != 1:
        raise UserError(
            f"{path}: expected one column {ARRIVAL}_s (or _ms, _us, _ns) that says when packets"
            f" arrived, got {', '.join(names or columns) or 'none'}"
        )
    (name,) = names
    values = columns[name].astype(np.int64 if columns[name].dtype.kind in "iu" else float)
    with np.errstate(invalid="ignore"):  # of infinite ones, which are refused next
        since = (values - values[0]).astype(float)
    if not np.isfinite(since).all() or (np.diff(since) < 0).any() or since[-1] <= 0:
        raise UserError(
            f"{path}: column {name} must be finite and never go back, and end later than it begins"
        )
    unit, expected = suffixes[name.rpartition("_")[2]], profile.stream.rate_hz
    usual, mean = 1.0 / _usual_step(since), (len(since) - 1) / since[-1]  # a unit of the column
    rates = {key: mean / factor for key, (factor, _) in stamps.UNITS.items()}
    near = [
        key
        for key, (factor, _) in stamps.UNITS.items()
        if expected / RATE_AGREES <= usual / factor <= expected * RATE_AGREES
    ]
    if unit in near:
        return since * stamps.UNITS[unit][0], f"column {name}", ()
    if len(near) != 1:
        raise UserError(
            f"{path}: by column {name} {rates[unit]:.4g} packets arrive in a second; console"
            f" {profile.name} sends {expected:g}. Name the column's unit, or write the rate into a"
            " profile of your own"
        )
    note = (
        f"column {name} is read as {near[0]}: {rates[near[0]]:.4g} packets a second;"
        f" {rates[unit]:.4g} as {unit}"
    )
    return since * stamps.UNITS[near[0]][0], f"column {name}", (note,)


def _usual_step(since: np.ndarray) -> float:
    """Mean time from packet to packet, without the longest in fifty: a pause is no other unit."""
    steps = np.sort(np.diff(since))
    most = len(steps) - (math.ceil(len(steps) / GAPS_IN) if len(steps) > GAPS_LEAST else 0)
    return float(steps[:most].mean()) or since[-1] / len(steps)


def _summed(
    path: Path,
    profile: ConsoleProfile,
    fields: Sequence[Sequence],
    arms: tuple[ArmName, ...],
    arrival_s: np.ndarray,
    clock: str,
    notes: tuple[str, ...],
) -> PacketStream:
    rows, count = len(fields), len(arms)
    delta, grasp = np.zeros((rows, count, 3)), np.zeros((rows, count))
    quat = np.tile(np.array([0.0, 0.0, 0.0, 1.0]), (rows, count, 1))
    pedal, counted = np.zeros(rows), np.zeros(rows, bool)
    reader, misfits, last = PacketReader(profile, arms), [], fields[0][0] - 1
    why: Misfit | None = None
    heard_s = float(arrival_s[0])  # when the stream last went on
    for row, packet in enumerate(fields):
        number = packet[0]
        joined = number == last + 1
        restarts = number < last and _restarts(number, last, arrival_s[row] - heard_s)
        result = reader.read(packet, joined and row > 0)
        if isinstance(result, Misfit):
            misfits.append(packet)
            why = result
        elif number and (number > last or restarts):
            reader.follow()
            last, heard_s = number, arrival_s[row]
            if joined:
                delta[row], quat[row], grasp[row] = result.delta_um, result.quat, result.grasp_mrad
                counted[row] = True
        pedal[row] = packet[MODE] if counted[row] else pedal[row - 1] if row else 0
    if len(misfits) > MOST_MISFITS * rows:
        others = [one for one in loading.bundled() if one != profile]
        fits = fitting(misfits, others, arms)
        advice = (
            f"they fit {fits}: write operator.console = '{fits}'"
            if fits
            else "no bundled profile fits them"
        )
        raise UserError(
            f"{path}: {len(misfits)} of {rows} packets do not fit console {profile.name}, the last"
            f" for {why}; {advice}"
        )
    return PacketStream(profile, arrival_s, delta, quat, grasp, pedal, counted, clock, notes)


def _restarts(number: int, last: int, silence_s: float) -> bool:
    """Whether a number below the last one begins the stream anew; that packet itself moves nothing.

    The robot's own rule, far behind; and those by which a console that was started again comes back
    in a session.
    """
    far = last > RESET_GAP and number < last - RESET_GAP
    return number > 0 and (
        far or (number == 1 and silence_s * 1e3 > QUIET_MS) or silence_s * 1e3 > RELEASE_MS
    )


def _accumulated(quat: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Orientation after each of `turns` [T, 4], each multiplied from the left as the robot does;
    [T, 4], unit.
    """
    from scipy.spatial.transform import Rotation

    out, at = np.empty((len(turns), 4)), Rotation.from_quat(quat)
    moving = np.flatnonzero(np.any(turns[:, :3] != 0.0, axis=1))
    begin = 0
    for row in moving.tolist():
        out[begin:row] = at.as_quat()
        at, begin = Rotation.from_quat(turns[row]) * at, row
    out[begin:] = at.as_quat()
    flips = np.cumprod(np.where(np.sum(out[1:] * out[:-1], axis=1) < 0.0, -1.0, 1.0))
    out[1:] *= flips[:, None]
    return out
