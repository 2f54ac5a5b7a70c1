"""Reads a recording in a bag of ROS 1 or ROS 2 (.bag, .db3): the same CRTK topics as an MCAP
file has.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.store.logs.bags import messages_of, opened
from ravenjax.store.motion.mcap_file import (
    ARM_TOPICS,
    JOINT_STATE,
    SOURCES,
    TopicValues,
    assembled,
    topic_of,
)
from ravenjax.store.motion.track import Track

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader

SUFFIXES = (".bag", ".db3")


def read(path: Path, arms: tuple[str, ...], rate_hz: float | None) -> Track:
    """The recording of `arms`. UserError names the topic and what is wrong with it."""
    with opened(path) as reader:
        kinds = {one.topic: one.msgtype for one in reader.connections}
        tips = {arm: _tips(path, reader, topic_of(path, kinds, ARM_TOPICS[arm])) for arm in arms}
        jaws = {arm: _jaws(path, reader, kinds, ARM_TOPICS[arm]) for arm in arms}
    return assembled(path, tips, jaws, rate_hz, list(kinds))


def arms_in(path: Path) -> tuple[str, ...]:
    """The arms that a bag has tip poses of."""
    with opened(path) as reader:
        topics = {one.topic for one in reader.connections}
    return tuple(
        arm
        for arm, prefix in ARM_TOPICS.items()
        if any(f"{prefix}{n}_cp" in topics for n in SOURCES)
    )


def _tips(path: Path, reader: AnyReader, topic: str) -> TopicValues:
    received, messages = messages_of(reader, topic)
    if not messages:
        raise UserError(f"{path}: {topic} has no messages; expected the tip's poses")
    poses = [one.pose for one in messages]
    values = [
        [*(getattr(one.position, c) for c in "xyz"), *(getattr(one.orientation, c) for c in "xyzw")]
        for one in poses
    ]
    return TopicValues(topic, received, _stamps(messages), np.array(values, float))


def _jaws(path: Path, reader: AnyReader, kinds: dict[str, str], prefix: str) -> TopicValues | None:
    topic = next((t for n in SOURCES if kinds.get(t := f"{prefix}{n}_js") == JOINT_STATE), None)
    if topic is None:
        return None
    received, messages = messages_of(reader, topic)
    if not messages:
        return None
    if any(not {*JOINTS[5:7]} <= {*one.name[: len(one.position)]} for one in messages):
        raise UserError(f"{path}: a message of {topic} is no {JOINT_STATE} with grasp1 and grasp2")
    opening = [
        sum(one.position[list(one.name).index(word)] for word in JOINTS[5:7]) for one in messages
    ]
    return TopicValues(topic, received, _stamps(messages), np.array(opening, float))


def _stamps(messages: list[Any]) -> np.ndarray:
    """Stamps of headers, ns [n]."""
    stamps = [one.header.stamp for one in messages]
    return np.array([one.sec * 10**9 + one.nanosec for one in stamps], np.int64)
