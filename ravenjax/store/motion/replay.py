"""Converts a recording of an operator's hands into a motion that the simulated arms can follow.

The motion has the length of the campaign and only poses that the arms can reach.
"""

import dataclasses
import functools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.motion import Motion
from ravenjax.store import files
from ravenjax.store.motion import resampling, spikes, timeline
from ravenjax.store.motion.options import ReplayOptions
from ravenjax.store.motion.reach import ArmReach, Bounds, reach_poses, unreached_reason
from ravenjax.store.motion.recording import (
    HandRecording,
    home_pose,
    load_recording,
    require_readable,
)
from ravenjax.store.motion.summary import ArmSummary, MotionSummary, TipCourse, format_spans
from ravenjax.store.motion.timeline import Timeline
from ravenjax.vocabulary import TICK_S

STILL_M, STILL_RAD = 5e-5, math.radians(0.2)
"""Largest movement and rotation of a tip that counts as at rest."""
OUTSIDE_LISTED = 8
"""Largest number of stretches that the summary lists as not replayable."""


@dataclasses.dataclass(frozen=True, eq=False)
class OperatorReplay:
    """An operator's motion for a campaign, made from a recording."""

    recording: HandRecording
    motion: Motion
    timeline: Timeline
    begin: int  # first replayed row of the recording
    end: int  # row after the last replayed row
    bounds: Bounds
    reach: ArmReach  # joint positions for every row of the recording
    scale: float  # teleoperation scale at which the tip moves exactly as recorded
    at_rest: tuple[str, ...]  # a notice about arms that do not move

    @property
    def rows(self) -> np.ndarray:
        """Fractional row of the recording that is replayed in each tick, [ticks]."""
        return self.begin + self.timeline.row

    @functools.cached_property
    def summary(self) -> MotionSummary:
        """Summary of the recording and of the motion."""
        recording, course = self.recording, self.timeline
        track, options, arms = recording.track, recording.options, recording.poses.arms
        times = recording.time_s[arms[0]]
        steps = np.diff(times) * 1e3
        gap = max(recording.gaps, key=lambda gap: gap[2] - gap[1], default=None)
        lost = ~(np.all(self.reach.inside, axis=1) & recording.covered)
        return MotionSummary(
            file=str(track.path),
            sha256=files.hash_file(track.path),
            options=options,
            rows=len(times),
            clock=track.clock,
            read=track.read,
            ignored=track.ignored,
            notes=track.notes,
            duration_s=times[-1] - times[0],
            rate_hz=1e3 / steps.mean(),
            steps_ms=(steps.min(), np.median(steps), steps.max()),
            gaps=len(recording.gaps),
            longest_gap=None if gap is None else (gap[0], gap[1], gap[2] - gap[1]),
            spikes=tuple(spike.words for spike in recording.spikes),
            outside=tuple(resampling.stretches_in_seconds(lost)[:OUTSIDE_LISTED]),
            outside_share=lost.mean(),
            window_s=(self.begin * TICK_S, (self.end - 1) * TICK_S),
            campaign_s=len(course.row) * TICK_S,
            end_s=course.end_s,
            turns=course.turns,
            pedal="down" if recording.pedal is None else "recorded",
            pedal_down=self.motion.surgeon_mode.mean(),
            scale=self.scale,
            arms=tuple(self._arm_summary(i, arm) for i, arm in enumerate(arms)),
            notices=(*self.at_rest, *self._cut_jaws()),
        )

    def _arm_summary(self, i: int, arm: ArmName) -> ArmSummary:
        # Summarizes the replayed motion of the arm with index i.
        recording, begin = self.recording, self.begin
        samples, inside = recording.track.arms[arm], self.reach.inside[recording.covered, i]
        path = resampling.at_rows(recording.poses.position[:, i], self.rows)
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        distance = np.linalg.norm(path, axis=1) * 1e3
        # What the low-pass filter removed from the positions: RMS, maximum, and its time.
        removed = None
        if recording.options.cutoff_hz is not None:
            removed_m = (recording.unfiltered - recording.poses.position)[begin : self.end, i]
            removed_mm = np.linalg.norm(removed_m, axis=1) * 1e3
            peak_s = (begin + int(np.argmax(removed_mm))) * TICK_S
            removed = np.sqrt(np.mean(removed_mm**2)), removed_mm.max(), peak_s
        return ArmSummary(
            arm=arm,
            orientation="home" if samples.quat is None else "recorded",
            jaws="home" if samples.opening_mrad is None else "recorded",
            inside=inside.mean() if len(inside) else 0.0,
            extent_mm=tuple(np.ptp(path, axis=0) * 1e3),
            path_mm=steps.sum() * 1e3,
            fastest_mm_s=steps.max(initial=0.0) * 1e3 / TICK_S,
            distance_mm=(distance.min(), distance.max()),
            start_mm=tuple(path[0] * 1e3),
            from_home_mm=float(np.linalg.norm(path[0] - home_pose(arm).position)) * 1e3,
            removed=removed,
        )

    def _cut_jaws(self) -> Iterator[str]:
        # Yields a notice if the control software limits the opening of an arm's jaws.
        motion, (gain, low, high) = self.motion, self.bounds.jaws
        for i, arm in enumerate(motion.arms):
            # The angles of the two jaws, joints 5 and 6, add up to the opening, here in mrad. The
            # operator's grasp, positive when it closes, changes it while the pedal is down.
            start = 1e3 * sum(motion.start_jpos[i][5:])
            opening = np.fix(start - gain * motion.grasp_mrad[motion.surgeon_mode > 0, i])
            beyond = np.maximum(low - opening, opening - high)
            if count := int((beyond > 0).sum()):
                yield (
                    f"{count:,} of {len(opening):,} samples open the jaws of {arm} beyond the"
                    f" limits of the control software, {low / 1e3:.3f} to {high / 1e3:.3f} rad, by"
                    f" up to {beyond.max() / 1e3:.3f} rad. The software stops them at the limit,"
                    " and the opening differs from the recording by this amount from then on"
                )


def replay_motion(
    path: Path,
    arms: tuple[ArmName, ...],
    options: ReplayOptions | None,
    ticks: int | None,
    scale: float,
    *,
    bounds: Bounds,
) -> OperatorReplay:
    """Return a recorded motion, replayed for `ticks` ms; None: until its window ends. scale:
    teleoperation scale at which the tip moves as recorded. bounds: soft joint limits. Raise
    UserError if the file cannot be used, or if the replayed part has a gap or a jump, is too short
    or leaves the joint limits.
    """
    path = Path(path)
    require_readable(path)
    parts = sorted(path.iterdir()) if path.is_dir() else [path]
    # `_replay` keeps its last results. A changed file has other states, so it is read again.
    states = tuple((file.stat().st_mtime_ns, file.stat().st_size) for file in parts)
    return _replay(path, states, arms, options or ReplayOptions(), ticks, scale, bounds)


# Cached, because a campaign is planned before it starts and at each look of its stop rule.
@functools.lru_cache(maxsize=2)
def _replay(
    path: Path,
    states: tuple[tuple[int, int], ...],
    arms: tuple[ArmName, ...],
    options: ReplayOptions,
    ticks: int | None,
    scale: float,
    bounds: Bounds,
) -> OperatorReplay:
    recording = load_recording(path, arms, options)
    reachable = reach_poses(recording.poses, bounds)
    begin, window_end = _window(recording)
    course = timeline.make_timeline(path, window_end - begin, ticks, options)
    # The row after the last that is replayed. The 1e-9 is for rounding errors, also below.
    end = begin + math.ceil(float(course.row.max()) - 1e-9) + 1
    _require_covered(recording, begin, end)
    _require_inside(recording, reachable, begin, end, bounds)
    pedal, rows = course.pedal, begin + course.row
    if recording.pedal is not None:
        pedal = pedal * recording.pedal[np.floor(rows + 1e-9).astype(int)]
    notices = _require_moving(recording, begin, end, rows[pedal > 0])
    poses = recording.poses
    hands = []
    for i, arm in enumerate(arms):
        tip = resampling.at_rows(poses.position[:, i], rows)
        turn = resampling.at_rows(poses.quat[:, i], rows)
        hands.append(_itp(arm, tip, turn, scale))
    position, quat = (np.stack(part, axis=1) for part in zip(*hands, strict=True))
    opening = resampling.at_rows(poses.opening_mrad, rows)
    motion = Motion(
        name=path.stem,
        arms=arms,
        position_um=position,
        quat=quat,
        # The console's grasp is positive when it closes.
        grasp_mrad=opening[0] - opening,
        surgeon_mode=pedal,
        start_jpos=tuple(tuple(reachable.jpos[begin, i].tolist()) for i in range(len(arms))),
    )
    return OperatorReplay(recording, motion, course, begin, end, bounds, reachable, scale, notices)


def require_scales(replay: OperatorReplay, scales: Sequence[float] | np.ndarray) -> None:
    """Raise UserError if the least or greatest of `scales` moves an arm out of its joint limits."""
    begin, end, base = replay.begin, replay.end, replay.scale
    poses = replay.recording.poses.part(begin, end)
    start = poses.position[:1]
    for scale in (float(np.max(scales)), float(np.min(scales))):
        if scale == base:
            continue
        magnified = poses._replace(position=start + scale / base * (poses.position - start))
        if (row := reach_poses(magnified, replay.bounds).first_bad(0, end - begin)) is None:
            continue
        raise UserError(
            f"{replay.recording.path}: operator.scale varied to {scale:g} moves the tip"
            f" {scale / base:.3g} times as far as recorded. At {(begin + row) * TICK_S:.3f} s of"
            " the recording the arm then leaves its joint limits. The recorded motion belongs to"
            f" the scale in [operator], now {base:g}. Vary the scale less, or write scale ="
            f" {scale:g} in [operator], so that the recorded motion belongs to this scale"
        )


def tip_courses(recording: HandRecording, inside: np.ndarray, rows: np.ndarray) -> list[TipCourse]:
    """Return the curves of a plot for each arm: recorded samples, and the replayed motion. inside:
    [rows, A] whether each pose is reachable. rows: see `OperatorReplay.rows`.
    """
    limit = recording.options.max_gap_s
    return [
        TipCourse(
            arm=arm,
            recorded_s=recording.time_s[arm],
            recorded=recording.track.arms[arm].position,
            replayed_s=rows * TICK_S,
            replayed=resampling.at_rows(recording.poses.position[:, i], rows),
            outside=tuple(resampling.stretches_in_seconds(recording.covered & ~inside[:, i])),
            gaps=tuple((begin, end) for _, begin, end in recording.gaps if end - begin > limit),
            spikes=tuple(spike.time_s for spike in recording.spikes if spike.arm == arm),
        )
        for i, arm in enumerate(recording.poses.arms)
    ]


def _window(recording: HandRecording) -> tuple[int, int]:
    # Returns the first row of the part to replay, and the row after its last. Rows are 1 ms apart.
    if recording.options.window_s is None:
        return 0, len(recording)
    begin, end = (round(seconds / TICK_S) for seconds in recording.options.window_s)
    if not 0 <= begin < end - 1 or end > len(recording):
        raise UserError(
            f"{recording.path}: window_s {list(recording.options.window_s)} is outside the"
            f" recording, expected in 0 .. {len(recording) * TICK_S:.3f} s"
        )
    return begin, end


def _require_covered(recording: HandRecording, begin: int, end: int):
    # Raises UserError if a gap or a jump is in the rows `begin` to `end` - 1. Interpolation over a
    # gap or jump would replay a motion that no operator made.
    first_s, last_s, path = begin * TICK_S, (end - 1) * TICK_S, recording.path
    jumps = [
        jump
        for jump in spikes.refused_jumps(recording.spikes, recording.options.spikes)
        if jump.begin_s < last_s and jump.end_s > first_s
    ]
    if jumps:
        raise spikes.spike_error(path, jumps, recording.options.spikes)
    limit = recording.options.max_gap_s
    # Length in s, row before the gap, and begin in s.
    gaps = [
        (end_s - begin_s, row, begin_s)
        for row, begin_s, end_s in recording.gaps
        if end_s - begin_s > limit and begin_s < last_s and end_s > first_s
    ]
    if not gaps:
        return
    length, row, begin_s = gaps[0]
    longest, longest_row, _ = max(gaps, key=lambda gap: gap[0])
    raise UserError(
        f"{path}: gap of {length:.3f} s after row {row} (t = {begin_s:.3f} s); expected at most"
        f" {limit:g} s between samples. {len(gaps)} such gaps, the longest {longest:.3f} s after"
        f" row {longest_row}. Replay a part without gaps: operator.window_s within"
        f" {format_spans(_longest_first(recording, recording.covered))}; or interpolate over the"
        f" gaps: operator.max_gap_s = {math.ceil(longest * 100) / 100:g}"
    )


def _require_inside(
    recording: HandRecording, reachable: ArmReach, begin: int, end: int, bounds: Bounds
):
    # Raises UserError if the arm cannot reach all poses of the part; it lists reachable parts.
    if (bad := reachable.first_bad(begin, end)) is None:
        return
    inside = np.all(reachable.inside, axis=1)
    leaps = np.flatnonzero(reachable.leaps).tolist()
    usable = _longest_first(recording, inside & recording.covered, leaps)
    replayed = f"from {begin * TICK_S:.3f} to {end * TICK_S:.3f} s, the part to replay"
    advice = (
        f"These parts can be reached, longest first: {format_spans(usable)}. Write a part, or a"
        " shorter time inside a part, as operator.window_s"
        if usable
        else "No row of the recording lies inside the joint limits of every arm"
    )
    if recording.options.place != "home":
        advice += (
            ". If positions use another frame, write operator.frame, operator.rotation and"
            ' operator.offset_mm, or operator.place = "home"'
        )
    share = 1.0 - float((inside & ~reachable.leaps)[begin:end].mean())
    raise UserError(
        f"{recording.path}: at {bad * TICK_S:.3f} s of the recording, an arm cannot reach the pose:"
        f" {unreached_reason(recording.poses, bad, bounds)}. Of the poses {replayed},"
        f" {100 * share:.3g} % cannot be reached within the soft joint limits. {advice}"
    )


def _longest_first(
    recording: HandRecording, mask: np.ndarray, cuts: Sequence[int] = ()
) -> list[tuple[float, float]]:
    """Return (begin, end) in s of the stretches of at least two rows in which `mask` is true, the
    longest first. A new stretch begins at each row in `cuts`, and after each gap.
    """
    return resampling.stretches_in_seconds(mask, sorted([*recording.cuts, *cuts]), shortest=2)


def _require_moving(
    recording: HandRecording, begin: int, end: int, rows: np.ndarray
) -> tuple[str, ...]:
    """Raise UserError if no arm moves while the pedal is down. Return a notice if only some move.
    rows: replayed rows with the pedal down, with fractions. Most faults have no effect while
    nothing moves, so a campaign would show too little harm.
    """
    span = f"from {begin * TICK_S:.3f} to {end * TICK_S:.3f} s"
    if not len(rows):
        raise UserError(
            f"{recording.path}: the pedal is never down {span}, so the robot would not move. Choose"
            " another part (operator.window_s), or remove the column surgeon_mode"
        )
    # The nearest whole rows.
    used, poses = np.unique(np.rint(rows).astype(int)), recording.poses
    extent_m = np.ptp(poses.position[used], axis=0).max(axis=1)
    # The scalar product of two unit quaternions is the cosine of half the angle between them.
    cosine = np.abs(np.sum(poses.quat[used] * poses.quat[used[:1]], axis=2)).min(axis=0)
    turn_rad = 2.0 * np.arccos(np.minimum(1.0, cosine))
    opening_rad = np.ptp(poses.opening_mrad[used], axis=0) * 1e-3
    at_rest = (extent_m <= STILL_M) & (np.maximum(turn_rad, opening_rad) <= STILL_RAD)
    extents = [
        f"the tip of {arm} stays within {extent * 1e6:.3g} um"
        for arm, extent, still in zip(poses.arms, extent_m, at_rest, strict=True)
        if still
    ]
    message = f"no motion {span}: {' and '.join(extents)}, expected more than {STILL_M * 1e6:g} um"
    if at_rest.all():
        raise UserError(
            f"{recording.path}: {message}. Choose another part (operator.window_s)."
            ' For hands at rest write operator.motion = "still" instead of the file'
        )
    return (message,) if at_rest.any() else ()


def _itp(
    arm: ArmName, position: np.ndarray, quat: np.ndarray, scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the console's positions [T, 3], um, and quaternions [T, 4] in the ITP frame, relative
    to the first row. position (m), quat: tip poses in frame 0. scale: teleoperation scale.
    """
    from scipy.spatial.transform import Rotation

    from ravenjax.robots.raven2.geometry.mapping import ITP_AXES

    # `axes @ x` converts a vector from the ITP frame to frame 0, `x @ axes` converts it back. Of a
    # quaternion, the first three numbers are a vector along the axis of the rotation.
    axes = np.array(ITP_AXES[arm])
    turns = Rotation.from_quat(quat)
    relative = (turns * turns[0].inv()).as_quat(canonical=True)
    hand = (position - position[0]) @ axes / scale * 1e6
    return hand, np.concatenate([relative[:, :3] @ axes, relative[:, 3:]], axis=1)
