"""Reads a recording from CRTK topics in an MCAP file or a bag of ROS 1 or ROS 2.

The package's docstring lists the topics.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ravenjax.errors import UserError, suggestion
from ravenjax.store.logs.bags import open_bag, read_joints, read_topic
from ravenjax.store.logs.topics import ARM_TOPICS, JOINT_STATE, POSE
from ravenjax.store.motion.track import ArmTrack, Track, unit_quaternions

SOURCES = ("setpoint", "measured")
"""Kinds of topics that a motion may come from, in order of preference."""


def arms_in(path: Path) -> tuple[str, ...]:
    """Return the arms for which a file has tip poses."""
    with open_bag(path) as reader:
        return tuple(
            arm
            for arm, name in ARM_TOPICS.items()
            if any(f"/{name}/{source}_cp" in reader.topics for source in SOURCES)
        )


def read_track(path: Path, arms: tuple[str, ...], rate_hz: float | None) -> Track:
    """Return the recording of `arms`.

    Raises UserError that names the topic and the problem.
    """
    with open_bag(path) as reader:
        kinds = {one.topic: one.msgtype for one in reader.connections if one.msgcount}
        tips = {arm: read_topic(path, reader, _tip_topic(path, kinds, arm)) for arm in arms}
        jaws = {
            arm: read_joints(path, reader, topic)
            for arm in arms
            for source in reversed(SOURCES)
            if kinds.get(topic := f"/{ARM_TOPICS[arm]}/{source}_js") == JOINT_STATE
        }
    by_header = all(one.stamps_run for one in tips.values())
    times = {arm: one.stamped_ns if by_header else one.arrived_ns for arm, one in tips.items()}
    begin = min(int(values[0]) for values in times.values())
    tracks = {}
    for arm, tip in tips.items():
        if len(tip.messages) < 2:
            raise UserError(
                f"{path}: {tip.topic} has {len(tip.messages)} messages; expected a motion of at"
                " least 2"
            )
        poses = np.array(
            [
                [*(getattr(message.pose.position, axis) for axis in "xyz")]
                + [*(getattr(message.pose.orientation, axis) for axis in "xyzw")]
                for message in tip.messages
            ],
            float,
        )
        if (bad := np.flatnonzero(~np.isfinite(poses).all(axis=1))).size:
            raise UserError(
                f"{path}: message {bad[0]} of {tip.topic}: got a number that is not finite"
            )
        opening = None
        if (jaw := jaws.get(arm)) is not None:
            at = jaw.time_ns if by_header else jaw.messages.arrived_ns
            if (np.diff(at) < 0).any() or np.isnan(jaw.joints[:, 5:]).any():
                raise UserError(
                    f"{path}: {jaw.messages.topic}: expected times that never go back, and"
                    " positions of grasp1 and grasp2 in every message"
                )
            opening = np.interp(times[arm] - begin, at - begin, jaw.joints[:, 5:].sum(axis=1) * 1e3)
        time_s = None if rate_hz is not None else (times[arm] - begin) * 1e-9
        turns = unit_quaternions(path, arm, poses[:, 3:])
        tracks[arm] = ArmTrack(time_s, poses[:, :3], turns, opening)
    clock, notes = "header stamps" if by_header else "log times", ()
    used = [one.topic for one in tips.values()]
    if rate_hz is None:
        clock = f"{clock} of {used[0]}"
    elif len({len(track) for track in tracks.values()}) > 1:
        counts = " and ".join(f"{one.topic} has {len(one.messages)}" for one in tips.values())
        raise UserError(
            f"{path}: {counts} messages; operator.rate_hz needs as many of each. Remove it: they"
            " have times"
        )
    else:
        notes = (f"{clock} are not used, operator.rate_hz spaces messages evenly",)
        clock = f"operator.rate_hz = {rate_hz:g}"
    used += [jaw.messages.topic for jaw in jaws.values()]
    ignored = tuple(sorted(kinds.keys() - used))
    return Track(path, clock, tracks, None, tuple(used), ignored, notes)


def _tip_topic(path: Path, kinds: dict[str, str], arm: str) -> str:
    """Return the topic of an arm's tip poses; kinds: type of each topic. Raises UserError."""
    wanted = [f"/{ARM_TOPICS[arm]}/{source}_cp" for source in SOURCES]
    topic = next((topic for topic in wanted if topic in kinds), None)
    if topic is None:
        raise UserError(
            f"{path}: no topic {' or '.join(wanted)} ({POSE}); the file has"
            f" {', '.join(sorted(kinds)) or 'none'}{suggestion(wanted[1], kinds)}"
        )
    if kinds[topic] != POSE:
        raise UserError(f"{path}: {topic} has schema {kinds[topic]!r}, expected {POSE!r}")
    return topic
