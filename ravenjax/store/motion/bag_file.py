"""Reads a recording in an MCAP file or a bag of ROS 1 or ROS 2, all of CRTK topics. The package's
docstring lists them.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ravenjax.errors import UserError, suggestion
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.store.logs.bags import TopicMessages, open_bag, read_topic
from ravenjax.store.logs.topics import ARM_TOPICS, JOINT_STATE, POSE
from ravenjax.store.motion.track import ArmTrack, Track, unit_quaternions

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

SUFFIXES = (".mcap", ".bag", ".db3")
SOURCES = ("setpoint", "measured")
"""What a motion is taken from: the first of them that the file has."""


def arms_in(path: Path) -> tuple[str, ...]:
    """The arms that a file has tip poses of."""
    with open_bag(path) as reader:
        return tuple(
            arm
            for arm, name in ARM_TOPICS.items()
            if any(f"/{name}/{source}_cp" in reader.topics for source in SOURCES)
        )


def read_track(path: Path, arms: tuple[str, ...], rate_hz: float | None) -> Track:
    """The recording of `arms`. UserError names the topic and what is wrong with it."""
    with open_bag(path) as reader:
        kinds = {one.topic: one.msgtype for one in reader.connections}
        tips = {arm: read_topic(path, reader, _tip_topic(path, kinds, arm)) for arm in arms}
        jaws = {arm: _jaws(path, reader, arm) for arm in arms}
    by_header = all(one.stamps_run for one in tips.values())
    times = {arm: one.stamped_ns if by_header else one.arrived_ns for arm, one in tips.items()}
    begin = min(int(values[0]) for values in times.values())
    topics, tracks = [one.topic for one in tips.values()], {}
    for arm, one in tips.items():
        if len(one.messages) < 2:
            raise UserError(
                f"{path}: {one.topic} has {len(one.messages)} messages; expected a motion of at"
                " least 2"
            )
        poses = np.array(
            [
                [*(getattr(message.pose.position, axis) for axis in "xyz")]
                + [*(getattr(message.pose.orientation, axis) for axis in "xyzw")]
                for message in one.messages
            ],
            float,
        )
        if (bad := np.flatnonzero(~np.isfinite(poses).all(axis=1))).size:
            raise UserError(
                f"{path}: message {bad[0]} of {one.topic}: got a number that is not finite"
            )
        opening = None
        if (jaw := jaws[arm]) is not None:
            topics.append(jaw.topic)
            at = jaw.stamped_ns if by_header and jaw.stamps_run else jaw.arrived_ns
            if (back := np.flatnonzero(np.diff(at) < 0)).size:
                raise UserError(
                    f"{path}: message {back[0] + 1} of {jaw.topic}: time goes back; expected it"
                    " never to"
                )
            opening = np.interp(times[arm] - begin, at - begin, _openings_mrad(path, jaw))
        time_s = None if rate_hz is not None else (times[arm] - begin) * 1e-9
        turns = unit_quaternions(path, arm, poses[:, 3:])
        tracks[arm] = ArmTrack(time_s, poses[:, :3], turns, opening)
    lengths = {one.topic: len(one.messages) for one in tips.values()}
    if rate_hz is not None and len(set(lengths.values())) > 1:
        counts = " and ".join(f"{topic} has {count}" for topic, count in lengths.items())
        raise UserError(
            f"{path}: {counts} messages; operator.rate_hz needs as many of each. Remove it: they"
            " have times"
        )
    clock, notes = "header stamps" if by_header else "log times", ()
    if rate_hz is None:
        clock = f"{clock} of {topics[0]}"
    else:
        notes = (f"{clock} are not used, operator.rate_hz spaces messages evenly",)
        clock = f"operator.rate_hz = {rate_hz:g}"
    ignored = tuple(sorted(name for name in kinds if name not in topics))
    return Track(path, clock, tracks, None, tuple(topics), ignored, notes)


def _tip_topic(path: Path, kinds: dict[str, str], arm: str) -> str:
    """The topic of an arm's tip poses; kinds: type of each topic. UserError."""
    wanted = [f"/{ARM_TOPICS[arm]}/{source}_cp" for source in SOURCES]
    for topic in wanted:
        if topic in kinds:
            if kinds[topic] != POSE:
                raise UserError(f"{path}: {topic} has schema {kinds[topic]!r}, expected {POSE!r}")
            return topic
    listed = ", ".join(sorted(kinds)) or "none"
    raise UserError(
        f"{path}: no topic {' or '.join(wanted)} ({POSE}); the file has"
        f" {listed}{suggestion(wanted[1], kinds)}"
    )


def _jaws(path: Path, reader: AnyReader, arm: str) -> TopicMessages | None:
    for source in SOURCES:
        topic = f"/{ARM_TOPICS[arm]}/{source}_js"
        there = reader.topics.get(topic)
        if there is not None and there.msgtype == JOINT_STATE and there.msgcount:
            return read_topic(path, reader, topic)
    return None


def _openings_mrad(path: Path, jaws: TopicMessages) -> np.ndarray:
    """Jaw openings [n]: the sum of both jaws."""
    openings = []
    for message in jaws.messages:
        angles = dict(zip(message.name, message.position, strict=False))
        if not {*JOINTS[5:7]} <= angles.keys():
            raise UserError(
                f"{path}: a message of {jaws.topic} is no {JOINT_STATE} with grasp1 and grasp2"
            )
        openings.append((angles[JOINTS[5]] + angles[JOINTS[6]]) * 1e3)
    return np.array(openings)
