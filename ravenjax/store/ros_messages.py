"""Definitions of the ROS 2 messages in a trace, in the ros2msg form that viewers read (common_interfaces)."""

from __future__ import annotations

from collections.abc import Sequence

_RULE = "=" * 80

HEADER = """builtin_interfaces/Time stamp
string frame_id"""
TIME = """int32 sec
uint32 nanosec"""
JOINT_STATE = """std_msgs/Header header
string[] name
float64[] position
float64[] velocity
float64[] effort"""
POSE_STAMPED = """std_msgs/Header header
geometry_msgs/Pose pose"""
POSE = """geometry_msgs/Point position
geometry_msgs/Quaternion orientation"""
POINT = """float64 x
float64 y
float64 z"""
QUATERNION = """float64 x
float64 y
float64 z
float64 w"""
STRING = """string data"""
WRENCH_STAMPED = """std_msgs/Header header
geometry_msgs/Wrench wrench"""
WRENCH = """geometry_msgs/Vector3 force
geometry_msgs/Vector3 torque"""


def _joined(main: str, **parts: str) -> str:
    """A definition followed by those it refers to; `geometry_msgs__Pose` names geometry_msgs/Pose."""
    parts |= {"std_msgs__Header": HEADER, "builtin_interfaces__Time": TIME}
    return main + "".join(f"\n{_RULE}\nMSG: {name.replace('__', '/')}\n{text}" for name, text in parts.items())


def signals(names: Sequence[str], kind: str = "float64") -> str:
    """Definition of the flat message: a header, then one number of this ROS type per name."""
    return _joined("\n".join(["std_msgs/Header header", *(f"{kind} {name}" for name in names)]))


DEFINITIONS = {
    "sensor_msgs/msg/JointState": _joined(JOINT_STATE),
    "geometry_msgs/msg/PoseStamped": _joined(
        POSE_STAMPED, geometry_msgs__Pose=POSE, geometry_msgs__Point=POINT, geometry_msgs__Quaternion=QUATERNION
    ),
    "geometry_msgs/msg/WrenchStamped": _joined(
        WRENCH_STAMPED, geometry_msgs__Wrench=WRENCH, geometry_msgs__Vector3=POINT
    ),
    "std_msgs/msg/String": STRING,
}
SIGNALS = "ravenjax_msgs/msg/Signals"
