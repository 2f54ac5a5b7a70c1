"""Creates, encodes and decodes messages of ROS 1 and ROS 2 with the rosbags library."""

from collections.abc import Mapping
from typing import Any, Literal

import numpy as np

Ros = Literal["ros1", "ros2"]

HEADER = "std_msgs/msg/Header"
JOINT_STATE = "sensor_msgs/msg/JointState"
POINT = "geometry_msgs/msg/PointStamped"
POSE = "geometry_msgs/msg/PoseStamped"
WRENCH = "geometry_msgs/msg/WrenchStamped"


class MessageTypes:
    """The message types of one ROS version."""

    def __init__(self, ros: Ros, definitions: Mapping[str, str] | None = None):
        """definitions: texts that define further types, by name of the type."""
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.ros: Ros = ros
        self.store = get_typestore(Stores.ROS1_NOETIC if ros == "ros1" else Stores.ROS2_HUMBLE)
        self._write, self._read = self.store.serialize_cdr, self.store.deserialize_cdr
        if ros == "ros1":
            self._write, self._read = self.store.serialize_ros1, self.store.deserialize_ros1
        for kind, text in (definitions or {}).items():
            types = get_types_from_msg(text, kind)
            known = self.store.types
            self.store.register({k: v for k, v in types.items() if k not in known})

    def encode(self, message: Any) -> bytes:
        """Encode a message: as CDR with its header, or in the format of ROS 1."""
        return bytes(self._write(message, message.__msgtype__))

    def decode(self, content: bytes, kind: str) -> Any:
        """Decode a message. Raise ValueError if the bytes are not a message of this type."""
        try:
            return self._read(content, kind)
        # The library may raise any exception here.
        except Exception as error:
            raise ValueError(f"not a message of type {kind}: {error}") from None

    def header(self, stamp_ns: int, frame: str = "") -> tuple[Any, ...]:
        """Return the fields of a header; stamp_ns: since 1970."""
        stamp = divmod(stamp_ns, 10**9)
        return (0, stamp, frame) if self.ros == "ros1" else (stamp, frame)

    def message(self, kind: str, *values: Any) -> Any:
        """Return a message from the values of its fields; a nested message is a list of values."""
        from rosbags.interfaces import Nodetype

        _, definitions = self.store.fielddefs[kind]
        fields = []
        node: Any
        for (_, node), value in zip(definitions, values, strict=True):
            nodetype, content = node
            # The type of the field is a message, a simple type, or an array of one of these.
            if nodetype == Nodetype.NAME:
                parts = (float(v) if isinstance(v, np.floating) else v for v in value)
                value = self.message(content, *parts)
            elif nodetype != Nodetype.BASE:
                # Its elements are messages of type `element`, or simple: (name, limit of length).
                element_type, element = content[0]
                if element_type == Nodetype.NAME:
                    value = [self.message(element, *entry) for entry in value]
                elif element[0] != "string":
                    value = np.asarray(value, element[0])
            fields.append(value)
        return self.store.types[kind](*fields)
