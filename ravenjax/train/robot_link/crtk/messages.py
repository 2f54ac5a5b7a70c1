"""Topics and messages of CRTK and of raven2, as ROS 1 and ROS 2 write them.

The common messages (`sensor_msgs/JointState` and so on) are those of the distributions, by
`rosbags`; those of CRTK and raven2 are defined here. Both ROS have the same fields, but for the
number in the header of ROS 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from ravenjax.store.logs.ros_types import (
    JOINT_STATE,
    POSE,
    TWIST,
    WRENCH,
    MessageTypes,
    Ros,
)
from ravenjax.train.robot import ArmName

JOY = "sensor_msgs/msg/Joy"
OPERATING_STATE = "crtk_msgs/msg/OperatingState"
STRING = "crtk_msgs/msg/StringStamped"
RAVEN_STATE = "raven_2/msg/raven_state"

CRTK_DEFINITIONS = {
    OPERATING_STATE: "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n",
    STRING: "std_msgs/Header header\nstring string\n",
}
DEFINITIONS = CRTK_DEFINITIONS | {
    RAVEN_STATE: """std_msgs/Header hdr
int32 runlevel
int32 sublevel
int32 last_seq
int32[2] type
int32[6] pos
float32[18] ori
float32[18] ori_d
int32[6] pos_d
duration dt
int32[16] encVals
int32[16] dac_val
float32[16] tau
float32[16] mpos
float32[16] jpos
float32[16] mvel
float32[16] jvel
float32[16] mpos_d
float32[16] jpos_d
float32[2] grasp_d
float32[16] encoffsets
float32[12] jac_vel
float32[12] jac_f
""",
}
"""Sources: crtk_msgs; raven2 `msg/raven_state.msg`."""

ARM_NAMES: dict[ArmName, str] = {"gold": "arm1", "green": "arm2"}
"""As raven2's own CRTK interface has them."""
_MEASURED = {
    "measured_js": JOINT_STATE,
    "setpoint_js": JOINT_STATE,
    "jaw/measured_js": JOINT_STATE,
    "jaw/setpoint_js": JOINT_STATE,
    "measured_cp": POSE,
    "setpoint_cp": POSE,
    "measured_cv": TWIST,
    "cue_cf": WRENCH,
}
SERVO = {
    "servo_cp": POSE,
    "servo_jp": JOINT_STATE,
    "servo_jr": JOINT_STATE,
    "jaw/servo_jp": JOINT_STATE,
}
"""Commands that are sent again and again, and are outdated soon."""
_COMMANDS = {"state_command": STRING, **SERVO, "move_jp": JOINT_STATE}
_PEDALS = ("console/operator_present", "console/clutch")
_KINDS = {
    **_MEASURED,
    **_COMMANDS,
    **dict.fromkeys(_PEDALS, JOY),
    "measured_cf": WRENCH,
    "operating_state": OPERATING_STATE,
    "ravenstate": RAVEN_STATE,
}


def kind_of(topic: str) -> str:
    """The type of a topic's messages; a topic such as `arm1/measured_js`."""
    return _KINDS[topic.removeprefix("arm1/").removeprefix("arm2/")]


def is_latched(topic: str) -> bool:
    """Whether who subscribes late gets the last message too."""
    return kind_of(topic) == OPERATING_STATE


def published(arms: Sequence[ArmName], ros: Ros, contact: bool = False) -> list[str]:
    """Topics of a robot with these arms. contact: it knows its force on what it touches."""
    words = ["operating_state", *_MEASURED, *(["measured_cf"] if contact else [])]
    own = ["ravenstate"] if ros == "ros1" else []
    return ["operating_state", *_of_arms(arms, words), *own]


def subscribed(arms: Sequence[ArmName]) -> list[str]:
    """Topics that command a robot with these arms."""
    return ["state_command", *_PEDALS, *_of_arms(arms, _COMMANDS)]


def reported(arms: Sequence[ArmName], ros: Ros) -> list[str]:
    """Topics in which another robot reports its state: raven2's own, or CRTK's of each arm."""
    words = ("measured_js", "setpoint_js", "operating_state")
    return ["ravenstate"] if ros == "ros1" else _of_arms(arms, words)


def _of_arms(arms: Sequence[ArmName], words: Sequence[str] | Mapping[str, str]) -> list[str]:
    return [f"{ARM_NAMES[arm]}/{word}" for arm in arms for word in words]


@cache
def types(ros: Ros) -> MessageTypes:
    """The message types of this ROS, with those of CRTK and raven2."""
    return MessageTypes(ros, DEFINITIONS if ros == "ros1" else CRTK_DEFINITIONS)


def pose_of(message: Any) -> tuple[np.ndarray, np.ndarray] | None:
    """Position and quaternion in a `PoseStamped`; None where they are not finite, or no pose."""
    point, turn = message.pose.position, message.pose.orientation
    numbers = np.array([point.x, point.y, point.z, turn.x, turn.y, turn.z, turn.w])
    if not np.isfinite(numbers).all() or not 0.9 < np.linalg.norm(numbers[3:]) < 1.1:
        return None
    return numbers[:3], numbers[3:]


def numbers_of(values: Any, count: int) -> np.ndarray | None:
    """These numbers where there are exactly so many and all are finite."""
    numbers = tuple(map(float, values))
    return np.array(numbers) if len(numbers) == count and all(map(math.isfinite, numbers)) else None


def stamp_ns(header: Any) -> int:
    """When a message was stamped, ns since 1970; 0: it was not."""
    return int(header.stamp.sec) * 10**9 + int(header.stamp.nanosec)
