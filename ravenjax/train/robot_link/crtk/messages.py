"""Defines the topics and messages of CRTK and raven2 for ROS 1 and ROS 2.

topics.toml lists the topics and defines the messages of CRTK and raven2. The rosbags library
defines all other messages. Fields are the same in both versions of ROS, but headers of ROS 1 also
have a number.
"""

import math
from collections import ChainMap
from collections.abc import Sequence
from functools import cache
from typing import Any

import numpy as np

from ravenjax import resources
from ravenjax.store.logs.ros_types import MessageTypes, Ros
from ravenjax.train.robot import ArmName, Arms

OPERATING_STATE = "crtk_msgs/msg/OperatingState"
STRING = "crtk_msgs/msg/StringStamped"
RAVEN_STATE = "raven_2/msg/raven_state"

ARM_NAMES: dict[ArmName, str] = {"gold": "arm1", "green": "arm2"}
"""Arm names of raven2's own CRTK interface."""
Arrivals = list[tuple[str, Any]]  # Topic and message of each arrival
_TOPICS = resources.read_tables(__file__, "topics.toml")
_DEFINITIONS = _TOPICS.pop("definitions")
_KINDS = ChainMap(*_TOPICS.values())
SERVO = tuple(_TOPICS["servo"])


def kind_of(topic: str) -> str:
    """Return the message type of a topic such as `arm1/measured_js`."""
    return _KINDS[topic.removeprefix("arm1/").removeprefix("arm2/")]


def is_latched(topic: str) -> bool:
    """Whether late subscribers get the last message too."""
    return kind_of(topic) == OPERATING_STATE


def published_topics(arms: Arms, ros: Ros, contact: bool = False) -> list[str]:
    """Return the topics that a robot with these arms publishes. contact: also its contact force."""
    words = [*_TOPICS["state"], *_TOPICS["measured"], *(_TOPICS["contact"] if contact else ())]
    robot_topics = [*_TOPICS["state"], *(_TOPICS["ros1"] if ros == "ros1" else ())]
    return [*robot_topics, *_arm_topics(arms, words)]


def command_topics(arms: Arms) -> list[str]:
    """Return the topics that command a robot with these arms."""
    words = [*_TOPICS["command"], *_TOPICS["servo"]]
    return ["state_command", *_TOPICS["pedal"], *_arm_topics(arms, words)]


def state_topics(arms: Arms, ros: Ros) -> list[str]:
    """Return the topics on which a real robot reports its state: raven2's `ravenstate` over ROS 1,
    CRTK's topics of each arm over ROS 2.
    """
    words = ("measured_js", "setpoint_js", "operating_state")
    return ["ravenstate"] if ros == "ros1" else _arm_topics(arms, words)


def _arm_topics(arms: Arms, words: Sequence[str]) -> list[str]:
    return [f"{ARM_NAMES[arm]}/{word}" for arm in arms for word in words]


@cache
def message_types(ros: Ros) -> MessageTypes:
    """Return the message types of this ROS, including those of CRTK and raven2."""
    ros1_definitions = _DEFINITIONS["ros1"] if ros == "ros1" else {}
    return MessageTypes(ros, _DEFINITIONS["ros2"] | ros1_definitions)


def pose_of(message: Any) -> tuple[np.ndarray, np.ndarray] | None:
    """Return position and quaternion. None: not finite, or no quaternion of about length 1."""
    point, turn = message.pose.position, message.pose.orientation
    numbers = numbers_of((point.x, point.y, point.z, turn.x, turn.y, turn.z, turn.w), 7)
    if numbers is None or not 0.9 < np.linalg.norm(numbers[3:]) < 1.1:
        return None
    return numbers[:3], numbers[3:]


def numbers_of(values: Any, count: int) -> np.ndarray | None:
    """Return the values as an array; None unless there are `count` of them and all are finite."""
    numbers = tuple(map(float, values))
    return np.array(numbers) if len(numbers) == count and all(map(math.isfinite, numbers)) else None


def stamp_ns(header: Any) -> int:
    """Return the time stamp of a header, ns since 1970; 0 if it is not set."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)
