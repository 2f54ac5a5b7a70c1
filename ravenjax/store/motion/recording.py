"""Resamples a recording to one row per millisecond, using the file's stamps or the stated rate,
with an optional filter.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ravenjax.errors import UserError
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS, ArmName
from ravenjax.robots.raven2.console.motion import TICK_S
from ravenjax.store import files
from ravenjax.store.logs import bags
from ravenjax.store.motion import resampling, spikes, stamps
from ravenjax.store.motion.options import ReplayOptions
from ravenjax.store.motion.packet_file import CAPTURES, PACKET, Home
from ravenjax.store.motion.reach import Poses
from ravenjax.store.motion.spikes import Spike
from ravenjax.store.motion.track import Track, check_plausible

KINDS = (*files.TABLES, *bags.SUFFIXES, *CAPTURES)
ANY_KIND = f"{', '.join(KINDS[:-1])} or {KINDS[-1]}"

USUAL_STEPS, LEAST_GAP_S = 3.0, 0.02
"""A gap is a step of more than USUAL_STEPS median steps that is longer than LEAST_GAP_S."""


@dataclasses.dataclass(frozen=True, eq=False)
class HandRecording:
    """Every sample of a file, and its motion at 1 kHz.

    Row k is k ms after the first moment at which all arms have a sample.
    """

    track: Track
    time_s: dict[str, np.ndarray]  # [T] of each arm's samples
    options: ReplayOptions
    poses: Poses  # poses for the replay
    unfiltered: np.ndarray  # [rows, A, 3] m, positions without the low-pass
    pedal: np.ndarray | None  # [rows]
    # [rows] False in gaps and jumps that the options refuse.
    covered: np.ndarray
    # Rows after these gaps and jumps, at which a new stretch begins.
    cuts: tuple[int, ...]
    spikes: tuple[Spike, ...]
    # Gaps in order: the row before each, its begin and its end.
    gaps: tuple[tuple[int, float, float], ...]

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.track.path

    def __len__(self) -> int:
        return len(self.covered)


def arms_in(path: Path) -> tuple[ArmName, ...]:
    """Return the arms that a file holds, gold first.

    Raises UserError if the file cannot be read, or holds none.
    """
    from ravenjax.store.motion import bag_file, table_file

    require_readable(path)
    suffix = path.suffix.lower()
    if suffix in CAPTURES:
        return ARMS
    if suffix in bags.SUFFIXES:
        held = bag_file.arms_in(path)
    else:
        table = files.read_table(path)
        held = ARMS if PACKET in table else table_file.arms_in(table)
    # Without any arm, the error names gold.
    return tuple(arm for arm in ARMS if arm in held) or ("gold",)


def _read_track(path: Path, arms: tuple[ArmName, ...], options: ReplayOptions) -> Track:
    from ravenjax.store.motion import bag_file, packet_file, table_file

    suffix = path.suffix.lower()
    table = files.read_table(path) if suffix in files.TABLES else None
    if suffix in CAPTURES or (table is not None and PACKET in table):
        homes: dict[ArmName, Home] = {arm: _home(arm) for arm in arms}
        return packet_file.read_track(path, arms, options.console, homes)
    if options.console != "auto":
        raise UserError(
            f"{path}: operator.console is of a stream of packets, this file holds tips: remove it"
        )
    if table is None:
        return bag_file.read_track(path, arms, options.rate_hz)
    return table_file.read_track(path, table, arms, options.rate_hz)


def load(path: Path, arms: tuple[ArmName, ...], options: ReplayOptions) -> HandRecording:
    """Return the recording of `arms`.

    Raises UserError for a file that cannot be used, whichever part of it is replayed.
    """
    require_readable(path)
    track = _read_track(path, arms, options)
    check_plausible(track)
    time_s = _times(track, options)
    jumps = [
        spike
        for arm in arms
        for spike in spikes.find(arm, track.arms[arm], time_s[arm], options.max_gap_s)
    ]
    rows = math.floor(min(times[-1] for times in time_s.values()) / TICK_S + 1e-6) + 1
    if rows < 2:
        raise UserError(
            f"{path}: lasts less than 2 ms, or its arms were not recorded at the same time"
        )
    unfiltered, pedal = _evenly(track, time_s, jumps, options, rows)
    gaps = tuple(_gaps(time_s))
    breaks = [(begin, end) for _, begin, end in gaps if end - begin > options.max_gap_s]
    breaks += [(spike.begin_s, spike.end_s) for spike in refused(jumps, options)]
    covered = np.ones(rows, bool)
    for begin, end in breaks:
        covered[math.floor(begin / TICK_S + 1e-6) + 1 : _row_at(end)] = False
    cuts = tuple(sorted(_row_at(end) for _, end in breaks))
    poses = unfiltered
    if options.cutoff_hz is not None:
        spans = resampling.stretches(covered, cuts)
        position, quat, opening = (
            resampling.low_pass(values, options.cutoff_hz, spans)
            for values in (poses.position, poses.quat, poses.opening_mrad)
        )
        quat /= np.linalg.norm(quat, axis=-1, keepdims=True)
        poses = Poses(poses.arms, position, quat, opening)
    return HandRecording(
        track=track,
        time_s=time_s,
        options=options,
        poses=poses,
        unfiltered=unfiltered.position,
        pedal=pedal,
        covered=covered,
        cuts=cuts,
        spikes=tuple(jumps),
        gaps=gaps,
    )


def require_readable(path: Path) -> None:
    """Raise UserError for a file of an unknown kind."""
    if not path.is_file():
        raise UserError(f"{path}: no such file; expected a recorded operator motion ({ANY_KIND})")
    if path.suffix.lower() not in KINDS:
        raise UserError(
            f"{path}: unknown kind of file {path.suffix.lower()!r}; expected {ANY_KIND}"
        )
    if path.stat().st_size == 0:
        raise UserError(f"{path}: the file is empty; expected a recorded operator motion")


def _times(track: Track, options: ReplayOptions) -> dict[str, np.ndarray]:
    """Return seconds of each arm's samples since the first moment at which all arms have one."""
    times: dict[str, np.ndarray] = {}
    for arm, one in track.arms.items():
        if one.time_s is None:
            times[arm] = np.arange(len(one)) / (options.rate_hz or math.nan)
        else:
            stamps.require_plausible(track.path, one.time_s, track.clock, options.max_gap_s)
            times[arm] = one.time_s
    begin = max(one[0] for one in times.values())
    return {arm: one - begin for arm, one in times.items()}


def _evenly(
    track: Track,
    time_s: dict[str, np.ndarray],
    jumps: list[Spike],
    options: ReplayOptions,
    rows: int,
) -> tuple[Poses, np.ndarray | None]:
    """Return poses and pedal, one row per millisecond."""
    at = np.arange(rows) * TICK_S
    position, quat, opening = [], [], []
    arms: tuple[ArmName, ...] = tuple(arm for arm in ARMS if arm in track.arms)
    for arm in arms:
        samples, times, home = track.arms[arm], time_s[arm], _home(arm)
        if options.spikes == "remove":
            samples, times = spikes.without(
                samples, times, [spike for spike in jumps if spike.arm == arm]
            )
        position.append(resampling.by_time(times, samples.position, at))
        quat.append(
            np.repeat(home.quat[None], rows, axis=0)
            if samples.quat is None
            else resampling.turns_by_time(times, samples.quat, at)
        )
        opening.append(
            np.full(rows, home.opening_mrad)
            if samples.opening_mrad is None
            else resampling.by_time(times, samples.opening_mrad, at)
        )
    pedal = None
    if track.surgeon_mode is not None:
        pedal = resampling.before(time_s[arms[0]], track.surgeon_mode, at)
    return Poses(arms, np.stack(position, 1), np.stack(quat, 1), np.stack(opening, 1)), pedal


def _gaps(time_s: dict[str, np.ndarray]) -> list[tuple[int, float, float]]:
    """Return (row before it, begin, end) of every gap, in order of time."""
    gaps: dict[tuple[float, float], int] = {}
    for times in time_s.values():
        steps = np.diff(times)
        for row in np.flatnonzero(
            steps > max(USUAL_STEPS * float(np.median(steps)), LEAST_GAP_S)
        ).tolist():
            gaps.setdefault((float(times[row]), float(times[row + 1])), row)
    return sorted(((row, begin, end) for (begin, end), row in gaps.items()), key=lambda gap: gap[1])


def refused(jumps: Sequence[Spike], options: ReplayOptions) -> list[Spike]:
    """Return the jumps that must not be replayed."""
    if options.spikes == "replay":
        return []
    return [spike for spike in jumps if options.spikes == "refuse" or not spike.rows]


def _row_at(time_s: float) -> int:
    """Return the first row that is not before a time."""
    return math.ceil(time_s / TICK_S - 1e-6)


def _home(arm: ArmName) -> Home:
    """Return the pose of a tip after homing."""
    from ravenjax.numbers.lazy import jax
    from ravenjax.robots.raven2.geometry import kinematics, limits, mapping

    with jax.enable_x64(True):
        pose = kinematics.forward(arm, Vec(np.float64(q) for q in limits.HOME_JPOS))
        return Home(
            np.array([float(c) for c in pose.position]),
            np.array([float(c) for c in mapping.quat_from_matrix(pose.rotation)]),
            (limits.HOME_JPOS[5] + limits.HOME_JPOS[6]) * 1e3,
        )
