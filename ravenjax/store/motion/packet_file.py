"""Reads a recorded stream of a console's packets as a motion: its increments, summed up from where homing ends.

The table has a column `packet` (124 bytes each) and one that says when each arrived. Whole packets are read under the
console's profile, in the order of the table. What the robot would drop moves nothing: repeated and older numbers, and
the packet after a gap.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import ARMS, ArmName
from ravenjax.robots.raven2.console import arrivals
from ravenjax.robots.raven2.console.choice import UNDECIDED, ProfileChoice, fitting
from ravenjax.robots.raven2.console.profile import ConsoleProfile
from ravenjax.robots.raven2.console.reading import FIELDS, MODE, Misfit, PacketReader, PacketReading
from ravenjax.robots.raven2.geometry.mapping import ITP_AXES
from ravenjax.store.consoles import loading
from ravenjax.store.motion import stamps
from ravenjax.store.motion.track import ArmTrack, Track
from ravenjax.vocabulary.packets import MOST_CYCLES

PACKET, ARRIVAL = "packet", "arrival"
MOST_MISFITS = 0.02
"""Of a recording: with more of them the profile is another console's."""
RATE_AGREES = 3.0
"""By so much the mean rate of arrivals may differ from the profile's."""


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


def stream(path: Path, arms: tuple[ArmName, ...], console: str) -> PacketStream:
    """The packets of a Parquet file. console: a profile of `store.consoles`, or "auto". UserError."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        table = pq.read_table(path)
    except (pa.ArrowException, OSError) as error:
        raise UserError(f"{path}: not a complete Parquet file: {str(error).splitlines()[0]}. Copy it again") from None
    datagrams = table[PACKET].to_pylist()
    if len(datagrams) < 2:
        raise UserError(f"{path}: holds {len(datagrams)} packets; expected a stream of at least 2")
    short = next((i for i, one in enumerate(datagrams) if not isinstance(one, bytes) or len(one) < FIELDS.size), None)
    if short is not None:
        raise UserError(f"{path}: row {short}, column {PACKET}: expected {FIELDS.size} bytes or more in each row")
    fields = [FIELDS.unpack_from(one) for one in datagrams]
    profile = _profile(path, fields, arms, console)
    columns = {name: table[name].to_numpy() for name in table.column_names if name != PACKET}
    arrival_s, clock, notes = _arrivals(path, columns, profile)
    return _summed(path, profile, fields, arms, arrival_s, clock, notes)


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
    cycles = arrivals.lengths(read.arrival_s * 1e3)
    shares = ", ".join(f"{share:g}" for share in arrivals.as_campaign(cycles))
    model = f"campaign.packets = [{shares}] makes packets last as long as these, up to {MOST_CYCLES} ms"
    note = f"packets are those of console {read.profile.name}; the robot would drop {lost:,} of {len(read.counted):,}"
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


def _profile(path: Path, fields: Sequence[Sequence], arms: tuple[ArmName, ...], console: str) -> ConsoleProfile:
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
            f"{path}: the packets fit no bundled profile of a console; write operator.console = 'FILE.toml'"
        )
    return loading.load(fits)


def _arrivals(
    path: Path, columns: dict[str, np.ndarray], profile: ConsoleProfile
) -> tuple[np.ndarray, str, tuple[str, ...]]:
    """Seconds since the first packet, the column, and a note where its unit is not what its name says."""
    suffixes = {word: unit for unit, (_, words) in stamps.UNITS.items() for word in words}
    names = [name for name in columns if name.rpartition("_")[0] in (ARRIVAL, *stamps.NAMES)]
    names = [name for name in names if name.rpartition("_")[2] in suffixes and columns[name].dtype.kind in "iuf"]
    if len(names) != 1:
        raise UserError(
            f"{path}: expected one column {ARRIVAL}_s (or _ms, _us, _ns) that says when packets arrived, got "
            f"{', '.join(names or columns) or 'none'}"
        )
    (name,) = names
    values = columns[name].astype(np.int64 if columns[name].dtype.kind in "iu" else float)
    with np.errstate(invalid="ignore"):  # of infinite ones, which are refused next
        since = (values - values[0]).astype(float)
    if not np.isfinite(since).all() or (np.diff(since) < 0).any() or since[-1] <= 0:
        raise UserError(f"{path}: column {name} must be finite and never go back, and end later than it begins")
    unit, expected = suffixes[name.rpartition("_")[2]], profile.stream.rate_hz
    rates = {key: (len(since) - 1) / (since[-1] * factor) for key, (factor, _) in stamps.UNITS.items()}
    near = [key for key, rate in rates.items() if expected / RATE_AGREES <= rate <= expected * RATE_AGREES]
    if unit in near:
        return since * stamps.UNITS[unit][0], f"column {name}", ()
    if len(near) != 1:
        raise UserError(
            f"{path}: by column {name} {rates[unit]:.4g} packets arrive in a second; console {profile.name} sends "
            f"{expected:g}. Name the column's unit, or write the rate into a profile of your own"
        )
    note = f"column {name} is read as {near[0]}: {rates[near[0]]:.4g} packets a second; {rates[unit]:.4g} as {unit}"
    return since * stamps.UNITS[near[0]][0], f"column {name}", (note,)


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
    for row, packet in enumerate(fields):
        number = packet[0]
        joined = number == last + 1
        result = reader.read(packet, joined and row > 0)
        if isinstance(result, Misfit):
            misfits.append(packet)
            why = result
        elif number > last:
            reader.follow()
            last = number
            if joined:
                delta[row], quat[row], grasp[row] = result.delta_um, result.quat, result.grasp_mrad
                counted[row] = True
        pedal[row] = packet[MODE] if counted[row] else pedal[row - 1] if row else 0
    if len(misfits) > MOST_MISFITS * rows:
        others = [one for one in loading.bundled() if one != profile]
        fits = fitting(misfits, others, arms)
        advice = f"they fit {fits}: write operator.console = '{fits}'" if fits else "no bundled profile fits them"
        raise UserError(
            f"{path}: {len(misfits)} of {rows} packets do not fit console {profile.name}, the last for {why}; {advice}"
        )
    return PacketStream(profile, arrival_s, delta, quat, grasp, pedal, counted, clock, notes)


def _accumulated(quat: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Orientation after each of `turns` [T, 4], each multiplied from the left as the robot does; [T, 4], unit."""
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
