"""Exchanges ROS 2 messages without a ROS installation, over DDS with the package cyclonedds.

Names and qualities of service follow ROS 2. For example, the topic `arm1/measured_js` is
`rt/arm1/measured_js` in DDS, `sensor_msgs/msg/JointState` is `sensor_msgs::msg::dds_::JointState_`,
and bytes are CDR. Published topics are reliable, so that both reliable and best-effort readers
match. Servo commands are read with best effort, because a command that DDS resends comes too late.
"""

import contextlib
import os
from collections.abc import Sequence
from functools import cache
from typing import Any

from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import make_idl_struct, types
from cyclonedds.idl.annotations import final
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.interfaces import Nodetype

from ravenjax.errors import UserError
from ravenjax.train.robot_link.crtk import messages

DOMAIN = "ROS_DOMAIN_ID"
QUEUE_LENGTH = 10
"""The largest number of messages that wait for a reader; the default of ROS 2."""
MAX_TAKEN = 64  # The largest number of messages taken from a topic at once


class DdsTransport:
    """Topics over DDS. `publish` and `poll` never wait longer than a millisecond."""

    def __init__(self, published: Sequence[str], subscribed: Sequence[str]):
        """Raises UserError if the domain is invalid."""
        self.types = messages.message_types("ros2")
        domain = os.environ.get(DOMAIN) or "0"
        if not domain.isdecimal() or int(domain) > 232:
            raise UserError(f"{DOMAIN} is {domain!r}, expected a whole number from 0 to 232")
        self._participant = DomainParticipant(int(domain))
        self._writers: dict[str, Any] = {}
        self._readers: list[tuple[str, Any]] = []
        for name in published:
            quality = _quality(latched=messages.is_latched(name))
            data = _data_type(messages.kind_of(name))
            topic = Topic(self._participant, f"rt/{name}", data, quality)
            self._writers[name] = DataWriter(self._participant, topic, quality)
        for name in subscribed:
            topic = Topic(self._participant, f"rt/{name}", _data_type(messages.kind_of(name)))
            reliable = not name.endswith(messages.SERVO)
            # A latched reader matches only latched writers, so there are two readers.
            for latched in {False, messages.is_latched(name)}:
                quality = _quality(reliable=reliable, latched=latched)
                self._readers.append((name, DataReader(self._participant, topic, quality)))

    def publish(self, name: str, message: Any) -> None:
        """Send a message of `types` to the readers of the topic."""
        data = _data_type(messages.kind_of(name))
        # If a slow reader leaves no room within a millisecond, the message is dropped.
        with contextlib.suppress(DDSException):
            self._writers[name].write(data.of(self.types.encode(message)))

    def poll(self) -> messages.Arrivals:
        """Return topic and message of each arrival, oldest first within a topic."""
        arrivals: messages.Arrivals = []
        for name, reader in self._readers:
            for sample in reader.take(N=MAX_TAKEN):
                content = getattr(sample, "content", None)
                # None: a publisher has left. ValueError: the message is invalid.
                with contextlib.suppress(ValueError):
                    if content is not None:
                        arrivals.append((name, self.types.decode(content, messages.kind_of(name))))
        return arrivals

    def connected(self) -> bool:
        """Whether any of the subscribed topics has a publisher."""
        return any(reader.get_matched_publications() for _, reader in self._readers)

    def close(self) -> None:
        self._readers.clear()
        self._writers.clear()
        del self._participant


def _quality(*, latched: bool, reliable: bool = True) -> Any:
    # Returns the quality of service of a topic. latched: late readers get the last message.
    reliability = Policy.Reliability
    return Qos(
        reliability.Reliable(duration(milliseconds=1)) if reliable else reliability.BestEffort,
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(1 if latched else QUEUE_LENGTH),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )


@cache
def _data_type(kind: str) -> Any:
    """Return the DDS type of a message such as `sensor_msgs/msg/JointState`. Its samples hold the
    serialised bytes. `serialize` and `deserialize`, which cyclonedds calls, only pass them on.
    """
    package, _, word = kind.split("/")
    definitions = messages.message_types("ros2").store.fielddefs[kind][1]
    fields = {name: _idl(node) for name, node in definitions}

    def of(cls, content: bytes, *_, **__):
        sample = cls.__new__(cls)
        sample.content = bytes(content)
        return sample

    data: Any = final(make_idl_struct(f"{word}_", f"{package}::msg::dds_::{word}_", fields))
    data.of = data.deserialize = classmethod(of)
    data.serialize = lambda self, *_, **__: self.content
    return data


def _idl(node) -> Any:
    # Returns the DDS type of a field. node: kind and content, as rosbags describes the field. The
    # content is a message's name, (node of the elements, length), or (name of a plain type, 0).
    kind, content = node
    if kind == Nodetype.NAME:
        return _data_type(content)
    if kind == Nodetype.SEQUENCE:
        return types.sequence[_idl(content[0])]
    if kind == Nodetype.ARRAY:
        return types.array[_idl(content[0]), content[1]]
    return {"string": str, "bool": bool}.get(content[0]) or getattr(types, content[0])
