"""Definitions of the ROS 2 messages of a log, put together as rosbag2 writes them into an MCAP
file.

Text of each type as in common_interfaces, geometry2 and rcl_interfaces, without the comments. A
schema is the text of its type, then that of each type that it needs, behind 80 times "=" and a line
"MSG: package/Name".
"""

from __future__ import annotations

import functools
from collections.abc import Sequence

_DELIMITER = "=" * 80

_TEXTS = {
    "builtin_interfaces/Time": "int32 sec\nuint32 nanosec\n",
    "geometry_msgs/Point": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/PointStamped": "std_msgs/Header header\nPoint point\n",
    "geometry_msgs/Pose": "Point position\nQuaternion orientation\n",
    "geometry_msgs/PoseStamped": "std_msgs/Header header\nPose pose\n",
    "geometry_msgs/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1\n",
    "geometry_msgs/Transform": "Vector3 translation\nQuaternion rotation\n",
    "geometry_msgs/TransformStamped": (
        "std_msgs/Header header\nstring child_frame_id\nTransform transform\n"
    ),
    "geometry_msgs/Vector3": "float64 x\nfloat64 y\nfloat64 z\n",
    "geometry_msgs/Wrench": "Vector3 force\nVector3 torque\n",
    "geometry_msgs/WrenchStamped": "std_msgs/Header header\nWrench wrench\n",
    "rcl_interfaces/Log": (
        "byte DEBUG=10\nbyte INFO=20\nbyte WARN=30\nbyte ERROR=40\nbyte"
        " FATAL=50\nbuiltin_interfaces/Time stamp\nuint8 level\nstring name\nstring msg\nstring"
        " file\nstring function\nuint32 line\n"
    ),
    "sensor_msgs/JointState": (
        "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[]"
        " effort\n"
    ),
    "std_msgs/Header": "builtin_interfaces/Time stamp\nstring frame_id\n",
    "std_msgs/String": "string data\n",
    "tf2_msgs/TFMessage": "geometry_msgs/TransformStamped[] transforms\n",
}
"""Text of each type by package/Name."""

SIGNALS = "ravenjax_msgs/msg/Signals"


@functools.cache
def definition(schema: str) -> str:
    """ros2msg text of a type named as `geometry_msgs/msg/PoseStamped`; KeyError for one that no
    log holds.
    """
    package, _, name = schema.split("/")
    return _joined(package, _TEXTS[f"{package}/{name}"])


def signals(names: Sequence[str], kind: str = "float64") -> str:
    """Definition of the flat message: a header, then one number of this ROS type per name."""
    fields = "".join(f"{kind} {name}\n" for name in names)
    return _joined("ravenjax_msgs", f"std_msgs/Header header\n{fields}")


def _joined(package: str, text: str) -> str:
    """A definition followed by those it needs, each once, in rosbag2's order: depth first, by
    name.
    """
    written: set[str] = set()

    def with_needed(package: str, text: str) -> str:
        out = text
        for name in sorted(_needed(package, text)):
            if name not in written:
                written.add(name)
                out += f"\n{_DELIMITER}\nMSG: {name}\n" + with_needed(
                    name.partition("/")[0], _TEXTS[name]
                )
        return out

    return with_needed(package, text)


def _needed(package: str, text: str) -> set[str]:
    """Types of the fields of a definition, as package/Name; a plain name is one of the
    definition's own package.
    """
    kinds = {line.split()[0].removesuffix("[]") for line in text.splitlines()}
    return {name for kind in kinds for name in (kind, f"{package}/{kind}") if name in _TEXTS}
