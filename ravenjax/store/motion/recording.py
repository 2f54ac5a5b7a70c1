"""Resamples a recording of an operator's hands to one row per millisecond.

The times are those of the file, or follow from a stated rate. A low-pass filter is optional.
"""

import contextlib
import dataclasses
import math
from pathlib import Path

import numpy as np

from ravenjax import resources
from ravenjax.errors import UserError
from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.arms import ARMS, ArmName
from ravenjax.store import files
from ravenjax.store.logs import bags
from ravenjax.store.logs.topics import ARM_TOPICS
from ravenjax.store.motion import packet_file, resampling, source, spikes, stamps
from ravenjax.store.motion.options import ReplayOptions
from ravenjax.store.motion.packet_file import CAPTURES, PACKET
from ravenjax.store.motion.reach import Poses
from ravenjax.store.motion.spikes import Spike
from ravenjax.store.motion.track import Home, Track, check_plausible, in_frame0
from ravenjax.vocabulary import TICK_S

KINDS = (*files.TABLES, *bags.SUFFIXES, *CAPTURES)
TABLE, BAG, STREAM = "table", "bag", "stream of packets"
OPTIONS_OF = resources.read_tables(__file__, "recording.toml")["kinds"]
"""Options that apply only to some kinds of recordings, with these kinds."""
ANY_KIND = f"{', '.join(KINDS[:-1])} or {KINDS[-1]}"


@dataclasses.dataclass(frozen=True, eq=False)
class HandRecording:
    """A recorded motion: the samples of the file, and the motion interpolated at 1 kHz. Row k of
    the interpolated motion is k ms after the first time at which all A arms have a sample.
    """

    track: Track
    time_s: dict[str, np.ndarray]  # arm -> times [T] of its samples
    options: ReplayOptions
    poses: Poses  # tip poses at 1 kHz, filtered if the options say so
    unfiltered: np.ndarray  # [rows, A, 3] m, positions before the low-pass filter
    pedal: np.ndarray | None  # [rows] 1 down, 0 up
    covered: np.ndarray  # [rows] False in gaps and jumps that the options do not permit
    # Rows after such gaps and jumps, at which a new continuous stretch begins.
    cuts: tuple[int, ...]
    spikes: tuple[Spike, ...]
    # Gaps in order: row before the gap, begin in s, end in s.
    gaps: tuple[tuple[int, float, float], ...]

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self.track.path

    def __len__(self) -> int:
        return len(self.covered)


def arms_in(path: Path) -> tuple[ArmName, ...]:
    """Return the arms that a file contains, gold first; gold if it has no names of arms. Raise
    UserError if the file cannot be read.
    """
    require_readable(path)
    found: tuple[ArmName, ...] = ARMS
    kind = _kind_of(path)
    if kind == BAG:
        with source.open_bag(path, ReplayOptions()) as bag:
            poses = "".join(topic for topic in bag.kinds if topic.endswith("_cp"))
            found = tuple(arm for arm in ARMS if f"{ARM_TOPICS[arm]}/" in poses)
    elif kind == TABLE:
        names = []
        # A table without a header line is an error here, but options may name its columns later.
        with contextlib.suppress(UserError):
            names = [*map(str, files.read_table(path))]
        found = tuple(arm for arm in ARMS if any(name.startswith(f"{arm}_x_") for name in names))
    return found or ("gold",)


def _kind_of(path: Path) -> str:
    # Returns the kind of a recording: BAG, STREAM or TABLE.
    suffix = path.suffix.lower()
    if bags.is_bag(path):
        return BAG
    packets = suffix in CAPTURES or (suffix == ".parquet" and PACKET in files.read_table(path))
    return STREAM if packets else TABLE


def _read_track(path: Path, arms: tuple[ArmName, ...], options: ReplayOptions) -> Track:
    # Reads a file by its kind. Options that apply only to other kinds of files are errors.
    kind = _kind_of(path)
    for name, kinds in OPTIONS_OF.items():
        value = getattr(options, name)
        if kind not in kinds and value != getattr(ReplayOptions(), name):
            raise UserError(
                f"{path}: this file is a {kind}, but operator.{name} applies to a"
                f" {' or a '.join(kinds)}: remove operator.{name} from the campaign"
            )
    for name in ("rotation", "offset_mm"):
        given = getattr(options, name)
        names = given if isinstance(given, dict) and given else arms
        lacking = [arm for arm in arms if arm not in names]
        if lacking:
            raise UserError(
                f"{path}: operator.{name} has a value for {', '.join(names)}, but none for"
                f" {lacking[0]}; write one for each arm, or a single value without names of arms"
            )
    if kind == STREAM:
        homes: dict[ArmName, Home] = {arm: home_pose(arm) for arm in arms}
        return packet_file.read_track(path, arms, options.console, homes)
    return source.read_track(path, arms, options)


def load_recording(path: Path, arms: tuple[ArmName, ...], options: ReplayOptions) -> HandRecording:
    """Return the recording of `arms`. Raise UserError for problems that prevent the replay of every
    part of the file.
    """
    require_readable(path)
    track = _read_track(path, arms, options)
    time_s = _times(track, options)
    begin_s = 0.0 if options.window_s is None else options.window_s[0]
    for arm in arms:
        first = min(int(np.searchsorted(time_s[arm], begin_s - 1e-9)), len(time_s[arm]) - 1)
        track.arms[arm] = in_frame0(track.arms[arm], arm, options, first, home_pose(arm))
    check_plausible(track)
    jumps = [
        spike
        for arm in arms
        for spike in spikes.find_spikes(arm, track.arms[arm], time_s[arm], options.max_gap_s)
    ]
    rows = math.floor(min(times[-1] for times in time_s.values()) / TICK_S + 1e-6) + 1
    if rows < 2:
        raise UserError(f"{path}: lasts less than 2 ms, or arms were recorded at different times")
    removed = jumps if options.spikes == "remove" else []
    unfiltered, pedal = _evenly(track, time_s, removed, rows)
    gaps = tuple(_gaps(time_s))
    breaks = [(begin, end) for _, begin, end in gaps if end - begin > options.max_gap_s]
    breaks += [(jump.begin_s, jump.end_s) for jump in spikes.refused_jumps(jumps, options.spikes)]
    covered = np.ones(rows, bool)
    for begin, end in breaks:
        covered[math.floor(begin / TICK_S + 1e-6) + 1 : _row_at(end)] = False
    cuts = tuple(sorted(_row_at(end) for _, end in breaks))
    poses = unfiltered
    if options.cutoff_hz is not None:
        spans = resampling.true_stretches(covered, cuts)
        smooth = (resampling.low_pass(x, options.cutoff_hz, spans) for x in unfiltered[1:])
        poses = Poses(unfiltered.arms, *smooth)
        length = np.linalg.norm(poses.quat, axis=-1, keepdims=True)
        poses = poses._replace(quat=poses.quat / length)
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
    """Raise UserError if a file is missing, of an unknown kind, or empty."""
    if path.is_dir() and bags.is_bag(path):
        return
    if not path.is_file():
        there = "no such file"
        if path.is_dir():
            there = "a folder without metadata.yaml, so not the folder of a bag of ROS 2"
        raise UserError(f"{path}: {there}; expected a recorded operator motion ({ANY_KIND})")
    if path.suffix.lower() not in KINDS:
        raise UserError(f"{path}: unknown kind of file {path.suffix.lower()!r}; write {ANY_KIND}")
    files.require_content(path)


def _times(track: Track, options: ReplayOptions) -> dict[str, np.ndarray]:
    """Return the times of each arm's samples, s. Time 0 is the first sample of the arm whose
    samples begin last. Earlier samples of other arms have negative times.
    """
    times = {}
    for arm, samples in track.arms.items():
        if samples.time_s is None:
            # `stamps.sample_times` has refused samples without times and without a rate.
            assert options.rate_hz is not None
            times[arm] = np.arange(len(samples)) / options.rate_hz
        else:
            stamps.require_plausible(track.path, samples.time_s, track.clock, options)
            times[arm] = samples.time_s
    latest_start = max(time_s[0] for time_s in times.values())
    return {arm: time_s - latest_start for arm, time_s in times.items()}


def _evenly(
    track: Track, time_s: dict[str, np.ndarray], removed: list[Spike], rows: int
) -> tuple[Poses, np.ndarray | None]:
    # Returns poses and pedal [rows], one row per millisecond, without the samples of the spikes
    # `removed`. What was not recorded stays as after homing; the pedal is None.
    row_s = np.arange(rows) * TICK_S
    parts = []
    arms: tuple[ArmName, ...] = tuple(arm for arm in ARMS if arm in track.arms)
    for arm in arms:
        samples, times, home = track.arms[arm], time_s[arm], home_pose(arm)
        removed_of_arm = [spike for spike in removed if spike.arm == arm]
        samples, times = spikes.remove_spikes(samples, times, removed_of_arm)
        quat, opening = np.tile(home.quat, (rows, 1)), np.full(rows, home.opening_mrad)
        if samples.quat is not None:
            quat = resampling.turns_by_time(times, samples.quat, row_s)
        if samples.opening_mrad is not None:
            opening = resampling.by_time(times, samples.opening_mrad, row_s)
        parts.append((resampling.by_time(times, samples.position, row_s), quat, opening))
    pedal = None
    if track.surgeon_mode is not None:
        # A switch keeps its state until its next sample. The 1e-9 is for rounding errors.
        last = np.searchsorted(time_s[arms[0]], row_s + 1e-9, side="right") - 1
        pedal = track.surgeon_mode[np.clip(last, 0, len(track.surgeon_mode) - 1)]
    return Poses(arms, *(np.stack(part, axis=1) for part in zip(*parts, strict=True))), pedal


def _gaps(time_s: dict[str, np.ndarray]) -> list[tuple[int, float, float]]:
    # Returns the gaps of all arms' samples, each once, as (row before the gap, begin, end), s.
    gaps: dict[tuple[float, float], int] = {}
    for times in time_s.values():
        for row, begin, end in stamps.find_gaps(times):
            gaps.setdefault((begin, end), row)
    return sorted(((row, begin, end) for (begin, end), row in gaps.items()), key=lambda gap: gap[1])


def _row_at(time_s: float) -> int:
    return math.ceil(time_s / TICK_S - 1e-6)


def home_pose(arm: ArmName) -> Home:
    # Returns the tip pose of an arm after homing.
    from ravenjax.numbers.lazy import jax
    from ravenjax.robots.raven2.geometry import kinematics, limits, mapping

    with jax.enable_x64(True):
        pose = kinematics.forward_pose(arm, Vec(np.float64(q) for q in limits.HOME_JPOS))
        return Home(
            np.array([float(c) for c in pose.position]),
            np.array([float(c) for c in mapping.quat_from_matrix(pose.rotation)]),
            (limits.HOME_JPOS[5] + limits.HOME_JPOS[6]) * 1e3,
        )
