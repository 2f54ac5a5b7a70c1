"""Measures what became of a recording."""

from __future__ import annotations

import numpy as np

from ravenjax.robots.raven2.console.motion import TICK_S
from ravenjax.robots.raven2.console.motions import MOTION_S
from ravenjax.store import files
from ravenjax.store.motion import resampling
from ravenjax.store.motion.recording import HandRecording
from ravenjax.store.motion.summary import ArmSummary, MotionSummary, line
from ravenjax.store.motion.timeline import RUN_UP_S, Timeline
from ravenjax.store.motion.view import words

UNFOLLOWED_MM = 0.1
"""Motion under a lifted pedal that is worth a note."""


def summary(
    recording: HandRecording,
    inside: np.ndarray,
    begin: int,
    end: int,
    course: Timeline,
    pedal: np.ndarray,
    scale: float,
) -> MotionSummary:
    track, options, poses = recording.track, recording.options, recording.poses
    times = recording.time_s[poses.arms[0]]
    steps = np.diff(times) * 1e3
    gap = max(recording.gaps, key=lambda one: one[2] - one[1], default=None)
    lost = ~(np.all(inside, axis=1) & recording.covered)
    outside = resampling.seconds(resampling.stretches(lost))
    lines = []
    for i, arm in enumerate(poses.arms):
        lines.append(line(arm, "recorded", recording.time_s[arm], track.arms[arm].position))
        lines.append(
            line(arm, "replayed", np.arange(begin, end) * TICK_S, poses.position[begin:end, i])
        )
    return MotionSummary(
        file=str(track.path),
        sha256=files.sha256(track.path),
        rows=len(times),
        clock=track.clock,
        read=track.read,
        ignored=track.ignored,
        notes=(*track.notes, *_unfollowed(recording, begin, course, pedal)),
        duration_s=float(times[-1] - times[0]),
        rate_hz=float(1e3 / steps.mean()),
        steps_ms=(float(steps.min()), float(np.median(steps)), float(steps.max())),
        gaps=len(recording.gaps),
        gap_s=None if gap is None else gap[2] - gap[1],
        gap_row=None if gap is None else gap[0],
        gap_begin_s=None if gap is None else gap[1],
        max_gap_s=options.max_gap_s,
        spikes=tuple(spike.words for spike in recording.spikes),
        spike_treatment=options.spikes,
        cutoff_hz=options.cutoff_hz,
        outside=tuple(sorted(outside, key=lambda span: span[0] - span[1])[: words.MOST]),
        outside_share=float(lost.mean()),
        window_s=(begin * TICK_S, (end - 1) * TICK_S),
        window_stated=options.window_s is not None,
        slow_down=options.slow_down,
        campaign_s=len(course.row) * TICK_S,
        rest_s=MOTION_S,
        run_up_s=RUN_UP_S,
        at_end=options.at_end,
        end_s=course.end_s,
        turns=course.turns,
        pedal="down" if recording.pedal is None else "recorded",
        pedal_down=float(np.mean(pedal)),
        scale=scale,
        arms=tuple(
            _arm_summary(recording, inside, i, begin, end, course) for i in range(len(poses.arms))
        ),
        lines=tuple(lines),
    )


def _unfollowed(
    recording: HandRecording, begin: int, course: Timeline, pedal: np.ndarray
) -> list[str]:
    """What the console does not send: motion while the recorded pedal is up."""
    notes = []
    for i, arm in enumerate(recording.poses.arms):
        path = resampling.at_rows(recording.poses.position[:, i], begin + course.row)
        dropped = np.cumsum(np.diff(path, axis=0) * (pedal[1:, None] == 0.0), axis=0)
        farthest = float(np.linalg.norm(dropped, axis=1).max(initial=0.0)) * 1e3
        if farthest > UNFOLLOWED_MM:
            notes.append(
                f"the recorded tip of {arm} moves while the pedal is up: the console sends no"
                f" motion then, and the tip goes on from where it is, up to {farthest:.3g} mm off"
                " the recorded path"
            )
    return notes


def _arm_summary(
    recording: HandRecording, inside: np.ndarray, i: int, begin: int, end: int, course: Timeline
) -> ArmSummary:
    samples = recording.track.arms[recording.poses.arms[i]]
    path = resampling.at_rows(recording.poses.position[:, i], begin + course.row)
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    distance = np.linalg.norm(path, axis=1) * 1e3
    removed = (
        np.linalg.norm((recording.unfiltered - recording.poses.position)[begin:end, i], axis=1)
        * 1e3
    )
    filtered = recording.options.cutoff_hz is not None
    x, y, z = (np.ptp(path, axis=0) * 1e3).tolist()
    return ArmSummary(
        arm=recording.poses.arms[i],
        orientation="home" if samples.quat is None else "recorded",
        jaws="home" if samples.opening_mrad is None else "recorded",
        inside=float(inside[recording.covered, i].mean()) if recording.covered.any() else 0.0,
        extent_mm=(x, y, z),
        path_mm=float(steps.sum()) * 1e3,
        fastest_mm_s=float(steps.max(initial=0.0)) * 1e3 / TICK_S,
        distance_mm=(float(distance.min()), float(distance.max())),
        removed_rms_mm=float(np.sqrt(np.mean(removed**2))) if filtered else None,
        removed_largest_mm=float(removed.max()) if filtered else None,
        removed_largest_s=(begin + int(np.argmax(removed))) * TICK_S if filtered else None,
    )
