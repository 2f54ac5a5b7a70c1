"""Messages of CRTK and of raven2, as ROS 1 and ROS 2 write them.

The common ones (`sensor_msgs/JointState` and so on) are those of the distributions, by `rosbags`;
what CRTK and raven2 define of their own is written down here. A message of ROS 1 and the same of
ROS 2 have the same fields, but for the number in the header of ROS 1.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, Literal, NamedTuple

import numpy as np

Ros = Literal["ros1", "ros2"]

JOINT_STATE = "sensor_msgs/msg/JointState"
JOY = "sensor_msgs/msg/Joy"
POSE = "geometry_msgs/msg/PoseStamped"
TWIST = "geometry_msgs/msg/TwistStamped"
WRENCH = "geometry_msgs/msg/WrenchStamped"
OPERATING_STATE = "crtk_msgs/msg/OperatingState"
STRING = "crtk_msgs/msg/StringStamped"
RAVEN_STATE = "raven_2/msg/raven_state"

OWN = {
    OPERATING_STATE: "std_msgs/Header header\nstring state\nbool is_homed\nbool is_busy\n",
    STRING: "std_msgs/Header header\nstring string\n",
    RAVEN_STATE: (
        """std_msgs/Header hdr
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
"""
    ),
}
"""Sources: crtk_msgs; raven2 `msg/raven_state.msg`."""
_NONE = np.zeros(0)


class TipPose(NamedTuple):
    """Where something is: m, and a unit quaternion x, y, z, w."""

    position: tuple[float, float, float]
    quat: tuple[float, float, float, float]


class MessageTypes:
    """The types of one ROS: makes messages, and bytes of them."""

    def __init__(self, ros: Ros, other: Mapping[str, str] | None = None) -> None:
        """other: definitions in place of those above, with those of their parts as ROS 1 sends
        them.
        """
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.ros: Ros = ros
        self.store = get_typestore(Stores.ROS1_NOETIC if ros == "ros1" else Stores.ROS2_HUMBLE)
        for kind, text in (OWN | dict(other or {})).items():
            if kind != RAVEN_STATE or ros == "ros1":
                types = get_types_from_msg(text, kind)
                self.store.register(
                    {name: one for name, one in types.items() if name not in self.store.types}
                )
        self._serialize = self.store.serialize_ros1 if ros == "ros1" else self.store.serialize_cdr
        self._deserialize = (
            self.store.deserialize_ros1 if ros == "ros1" else self.store.deserialize_cdr
        )

    def encode(self, message: Any, kind: str) -> bytes:
        """The bytes of a message: CDR with its head, or ROS 1's own."""
        return bytes(self._serialize(message, kind))

    def decode(self, content: bytes, kind: str) -> Any:
        """The message; ValueError where the bytes are none."""
        try:
            return self._deserialize(content, kind)
        except Exception as error:  # whatever the library stumbles over
            raise ValueError(f"no {kind}: {error}") from None

    def header(self, stamp_ns: int, frame: str) -> Any:
        """A header; stamp_ns: since 1970."""
        time = self._time(stamp_ns)
        header = self.store.types["std_msgs/msg/Header"]
        return header(0, time, frame) if self.ros == "ros1" else header(time, frame)

    def _time(self, stamp_ns: int) -> Any:
        return self.store.types["builtin_interfaces/msg/Time"](*divmod(stamp_ns, 10**9))

    def joint_state(
        self,
        header: Any,
        names: Sequence[str],
        position: Sequence[float] | np.ndarray,
        velocity: Sequence[float] | np.ndarray | None = None,
    ) -> Any:
        """Joints: rad, insertion m, per s."""
        there = _NONE if velocity is None else np.asarray(velocity, float)
        return self.store.types[JOINT_STATE](
            header, list(names), np.asarray(position, float), there, _NONE
        )

    def pose(self, header: Any, pose: TipPose) -> Any:
        """A pose, m."""
        return self.store.types[POSE](header, self.plain_pose(pose))

    def plain_pose(self, pose: TipPose) -> Any:
        """A pose without a header."""
        types = self.store.types
        point = types["geometry_msgs/msg/Point"](*pose.position)
        return types["geometry_msgs/msg/Pose"](
            point, types["geometry_msgs/msg/Quaternion"](*pose.quat)
        )

    def twist(self, header: Any, linear: np.ndarray, angular: np.ndarray) -> Any:
        """A velocity: m/s, rad/s."""
        twist = self.store.types["geometry_msgs/msg/Twist"](
            self._vector(linear), self._vector(angular)
        )
        return self.store.types[TWIST](header, twist)

    def wrench(self, header: Any, force: np.ndarray) -> Any:
        """A force without a torque."""
        wrench = self.store.types["geometry_msgs/msg/Wrench"](
            self._vector(force), self._vector(np.zeros(3))
        )
        return self.store.types[WRENCH](header, wrench)

    def operating_state(self, header: Any, state: str, is_homed: bool, is_busy: bool) -> Any:
        """The state of an arm."""
        return self.store.types[OPERATING_STATE](header, state, is_homed, is_busy)

    def string(self, header: Any, text: str) -> Any:
        """A word with a stamp."""
        return self.store.types[STRING](header, text)

    def joy(self, header: Any, buttons: Sequence[int]) -> Any:
        """Buttons of a pedal tray."""
        return self.store.types[JOY](header, np.zeros(0, np.float32), np.asarray(buttons, np.int32))

    def _vector(self, xyz: np.ndarray) -> Any:
        return self.store.types["geometry_msgs/msg/Vector3"](*xyz.tolist())


@cache
def types(ros: Ros) -> MessageTypes:
    """Of this ROS; read once."""
    return MessageTypes(ros)


def pose_of(message: Any) -> TipPose | None:
    """The pose in a `PoseStamped`, its quaternion at length 1; None where it is none or not
    finite.
    """
    point, turn = message.pose.position, message.pose.orientation
    position, quat = (point.x, point.y, point.z), (turn.x, turn.y, turn.z, turn.w)
    length = math.hypot(*quat)
    if not all(map(math.isfinite, (*position, *quat))) or not 0.9 < length < 1.1:
        return None
    x, y, z, w = (number / length for number in quat)
    return TipPose(position, (x, y, z, w))


def numbers_of(values: Any, count: int) -> tuple[float, ...] | None:
    """The first field's numbers where there are exactly so many and all are finite."""
    numbers = tuple(map(float, values))
    return numbers if len(numbers) == count and all(map(math.isfinite, numbers)) else None


def stamp_ns(message: Any) -> int:
    """When a message was stamped, ns since 1970; 0: it was not."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)
