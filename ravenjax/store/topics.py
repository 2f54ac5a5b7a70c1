"""Topics of MCAP logs: name, schema and layout of the messages that a trace and a session share.

Names are CRTK's as raven2 has them: gold is arm1, green arm2. Poses are in frame 0 of their arm.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mcap.writer import Writer

from ravenjax.store import ros_messages
from ravenjax.store.cdr import Layout
from ravenjax.store.schema import JOINTS

ARM_TOPICS = {"gold": "arm1", "green": "arm2"}
SIGNALS = "/ravenjax/signals"
"""The flat message: every scalar under a name of its own."""


@dataclass(frozen=True)
class Topic:
    """One topic; its messages are `layout` filled with numbers."""

    name: str
    schema: str
    definition: str  # ros2msg text of the schema
    layout: Layout


def joint_state(arm: str, name: str, position: bool = True, velocity: bool = False, effort: bool = False) -> Topic:
    """sensor_msgs/JointState of the seven joints: those of position, velocity, effort that there are, in this order."""
    layout = _framed(arm)
    layout.texts(JOINTS)
    for there in (position, velocity, effort):
        layout.sequence(len(JOINTS) if there else 0)
    return _topic(arm, name, "sensor_msgs/msg/JointState", layout)


def pose(arm: str, name: str) -> Topic:
    """geometry_msgs/PoseStamped: x, y, z in m and a quaternion x, y, z, w; all zero where there is no rotation."""
    layout = _framed(arm)
    layout.numbers(7)
    return _topic(arm, name, "geometry_msgs/msg/PoseStamped", layout)


def wrench(arm: str, name: str) -> Topic:
    """geometry_msgs/WrenchStamped: three of force, three of torque."""
    layout = _framed(arm)
    layout.numbers(6)
    return _topic(arm, name, "geometry_msgs/msg/WrenchStamped", layout)


def signals(names: Sequence[str], single: bool = False) -> Topic:
    """The flat message of one number per name: float64, or float32 if `single`."""
    layout = Layout("")
    if single:
        layout.singles(len(names))
    else:
        layout.numbers(len(names))
    definition = ros_messages.signals(names, "float32" if single else "float64")
    return Topic(SIGNALS, ros_messages.SIGNALS, definition, layout)


def text(name: str) -> Topic:
    """std_msgs/String; its messages are `cdr.string`'s."""
    return Topic(name, "std_msgs/msg/String", ros_messages.DEFINITIONS["std_msgs/msg/String"], Layout(""))


def register(writer: Writer, topics: Iterable[Topic]) -> list[int]:
    """Tell the writer of the topics; the channel number of each."""
    schemas: dict[str, int] = {}
    channels = []
    for topic in topics:
        if topic.schema not in schemas:
            schemas[topic.schema] = writer.register_schema(topic.schema, "ros2msg", topic.definition.encode())
        channels.append(writer.register_channel(topic.name, "cdr", schemas[topic.schema]))
    return channels


def field(name: str) -> str:
    """A field name as ROS 2 allows it: lower case letters, digits, single underscores."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def _framed(arm: str) -> Layout:
    return Layout(f"{ARM_TOPICS[arm]}_base")


def _topic(arm: str, name: str, schema: str, layout: Layout) -> Topic:
    return Topic(f"/{ARM_TOPICS[arm]}/{name}", schema, ros_messages.DEFINITIONS[schema], layout)
