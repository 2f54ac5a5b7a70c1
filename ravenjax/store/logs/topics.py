"""Topics of MCAP logs: name, schema and layout of the messages that a trace and a session share.

Names are CRTK's as raven2 has them: gold is arm1, green arm2. Poses are in frame 0 of their arm,
which is the frame `armN_base`. An orientation that nobody knows is not published: where there is
none the message is a point.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from mcap.writer import Writer

from ravenjax.store.logs import cdr, ros_messages
from ravenjax.store.logs.cdr import MessageLayout

ARM_TOPICS = {"gold": "arm1", "green": "arm2"}
"""CRTK's names of the arms of a Raven-II; an arm of another robot keeps its own."""
SIGNALS = "/ravenjax/signals"
"""The flat message: every scalar under a name of its own."""
EVENTS = "/ravenjax/events"
"""What happened, one JSON object a message, for programs."""
LOG = "/ravenjax/log"
"""The same in words, for people: viewers show it as a log."""
FRAMES = "/tf"
WORLD = "world"
LEVELS = {"debug": 10, "info": 20, "warn": 30, "error": 40, "fatal": 50}
"""Severities of rcl_interfaces/Log."""


@dataclass(frozen=True)
class Topic:
    """One topic; its messages are `layout` filled with numbers."""

    name: str
    schema: str
    definition: str  # ros2msg text of the schema
    layout: MessageLayout

    def encode(self, time_ns: np.ndarray, values: np.ndarray) -> dict[int, bytes]:
        """Messages by tick: `time_ns` int64 [T], `values` [T, numbers]. Of a pose, point or frame
        that is not known in a tick (a number is none) there is no message then."""
        ticks = (
            np.flatnonzero(np.isfinite(values).all(axis=1))
            if self.schema in _OF_PLACES
            else range(len(values))
        )
        return dict(
            zip(map(int, ticks), self.layout.encode(time_ns[ticks], values[ticks]), strict=True)
        )


_OF_PLACES = (
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PointStamped",
    "tf2_msgs/msg/TFMessage",
)


def base(arm: str) -> str:
    """Name of the frame that all poses of an arm are in, its frame 0."""
    return f"{arm_name(arm)}_base"


def tip(arm: str, which: str) -> str:
    """Name of the frame of an arm's jaws: `which` is measured, true or model."""
    return f"{arm_name(arm)}_tip_{which}"


def joint_state(
    arm: str,
    name: str,
    joints: Sequence[str],
    position: bool = True,
    velocity: bool = False,
    effort: bool = False,
) -> Topic:
    """sensor_msgs/JointState of the joints: those of position, velocity, effort that there are,
    in this order.
    """
    layout = _framed(arm)
    layout.texts(joints)
    for there in (position, velocity, effort):
        layout.sequence(len(joints) if there else 0)
    return _of_arm(arm, name, "sensor_msgs/msg/JointState", layout)


def pose(arm: str, name: str) -> Topic:
    """geometry_msgs/PoseStamped: x, y, z in m and a quaternion x, y, z, w."""
    layout = _framed(arm)
    layout.numbers(7)
    return _of_arm(arm, name, "geometry_msgs/msg/PoseStamped", layout)


def point(arm: str, name: str) -> Topic:
    """geometry_msgs/PointStamped: x, y, z in m, of a tip whose orientation is not known."""
    layout = _framed(arm)
    layout.numbers(3)
    return _of_arm(arm, name, "geometry_msgs/msg/PointStamped", layout)


def wrench(arm: str, name: str) -> Topic:
    """geometry_msgs/WrenchStamped: three of force, three of torque."""
    layout = _framed(arm)
    layout.numbers(6)
    return _of_arm(arm, name, "geometry_msgs/msg/WrenchStamped", layout)


def frames(pairs: Sequence[tuple[str, str]]) -> Topic:
    """tf2_msgs/TFMessage: of each (parent, child) the place x, y, z in m and the quaternion x,
    y, z, w.
    """
    layout = MessageLayout()
    layout.count(len(pairs))
    for parent, child in pairs:
        layout.header(parent)
        layout.text(child)
        layout.numbers(7)
    return _topic(FRAMES, "tf2_msgs/msg/TFMessage", layout)


def signals(names: Sequence[str], single: bool = False) -> Topic:
    """The flat message of one number per name: float64, or float32 if `single`."""
    layout = MessageLayout()
    layout.header("")
    if single:
        layout.singles(len(names))
    else:
        layout.numbers(len(names))
    definition = ros_messages.signals(names, "float32" if single else "float64")
    return Topic(SIGNALS, ros_messages.SIGNALS, definition, layout)


def events() -> tuple[Topic, Topic]:
    """std_msgs/String and rcl_interfaces/Log; their messages are `encoded_event`'s."""
    return _topic(EVENTS, "std_msgs/msg/String", MessageLayout()), _topic(
        LOG, "rcl_interfaces/msg/Log", MessageLayout()
    )


def encoded_event(
    event: Mapping[str, Any], text: str, level: str, stamp_ns: int
) -> tuple[bytes, bytes]:
    """An event as messages of the two topics of `events`. `level` is one of LEVELS."""
    return cdr.string(json.dumps(event)), cdr.log(stamp_ns, LEVELS[level], str(event["kind"]), text)


def register(writer: Writer, topics: Iterable[Topic]) -> list[int]:
    """Tell the writer of the topics; the channel number of each."""
    schemas: dict[str, int] = {}
    channels = []
    for topic in topics:
        if topic.schema not in schemas:
            schemas[topic.schema] = writer.register_schema(
                topic.schema, "ros2msg", topic.definition.encode()
            )
        channels.append(writer.register_channel(topic.name, "cdr", schemas[topic.schema]))
    return channels


def field(name: str) -> str:
    """A field name as ROS 2 allows it: lower case letters, digits, single underscores."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def arm_name(arm: str) -> str:
    """What an arm is called in topics and frames."""
    return ARM_TOPICS.get(arm) or field(arm)


def _framed(arm: str) -> MessageLayout:
    layout = MessageLayout()
    layout.header(base(arm))
    return layout


def _of_arm(arm: str, name: str, schema: str, layout: MessageLayout) -> Topic:
    return _topic(f"/{arm_name(arm)}/{name}", schema, layout)


def _topic(name: str, schema: str, layout: MessageLayout) -> Topic:
    return Topic(name, schema, ros_messages.definition(schema), layout)
