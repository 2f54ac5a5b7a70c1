"""ROS 2 without a ROS installation: DDS by the `cyclonedds` wheel, names and qualities of service
as ROS 2 has them.

A topic `arm1/measured_js` is `rt/arm1/measured_js` there, `sensor_msgs/msg/JointState` is
`sensor_msgs::msg::dds_::JointState_`, bytes are CDR. What is published is reliable, so that readers
of either kind match; servo commands are read as best effort, so that a late one is never sent
again.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from types import new_class
from typing import Any

from ravenjax.errors import UserError
from ravenjax.train.robot_link.crtk import messages
from ravenjax.train.robot_link.crtk.names import SERVO, RosTopic

DOMAIN = "ROS_DOMAIN_ID"
DEPTH = 10
"""Messages that wait for a reader, as ROS 2 has it where nobody says otherwise."""
MOST_TAKEN = 64
"""Of a topic, in one look."""


class DdsTransport:
    """Topics over DDS. `publish` and `poll` never wait longer than a millisecond."""

    ros: messages.Ros = "ros2"

    def __init__(
        self, published: Sequence[RosTopic], subscribed: Sequence[RosTopic], name: str = "ravenjax"
    ) -> None:
        """UserError where the wheel or a sound domain is missing."""
        _require()
        from cyclonedds.domain import DomainParticipant
        from cyclonedds.pub import DataWriter
        from cyclonedds.sub import DataReader
        from cyclonedds.topic import Topic as DdsTopic

        self.types = messages.types("ros2")
        self.unsent = 0
        self.garbled = 0
        self._participant = DomainParticipant(domain())
        self._writers: dict[str, tuple[Any, Any, str]] = {}
        self._readers: list[tuple[str, str, Any]] = []
        for one in published:
            quality = _quality(latched=one.latched)
            data = _data_type(one.kind)
            topic = DdsTopic(self._participant, f"rt/{one.name}", data, quality)
            self._writers[one.name] = DataWriter(self._participant, topic, quality), data, one.kind
        for one in subscribed:
            topic = DdsTopic(self._participant, f"rt/{one.name}", _data_type(one.kind))
            for latched in {
                False,
                one.latched,
            }:  # who wants to hear the last one does not match who does not keep it
                quality = _quality(reliable=not one.name.endswith(SERVO), latched=latched)
                self._readers.append(
                    (one.name, one.kind, DataReader(self._participant, topic, quality))
                )

    def publish(self, name: str, message: Any) -> None:
        """Send a message of `types` to whoever reads the topic."""
        from cyclonedds.core import DDSException

        writer, data, kind = self._writers[name]
        try:
            writer.write(data.of(self.types.encode(message, kind)))
        except DDSException:  # no room within a millisecond: a reader that does not read
            self.unsent += 1

    def poll(self) -> list[tuple[str, Any]]:
        """Topic and message of what has come, oldest first within a topic."""
        arrivals: list[tuple[str, Any]] = []
        for name, kind, reader in self._readers:
            for sample in reader.take(N=MOST_TAKEN):
                content = getattr(sample, "content", None)
                if content is None:  # somebody has left
                    continue
                try:
                    arrivals.append((name, self.types.decode(content, kind)))
                except ValueError:
                    self.garbled += 1
        return arrivals

    def writers(self, name: str) -> int:
        """How many publish what is subscribed to under this name."""
        return sum(
            len(reader.get_matched_publications())
            for one, _, reader in self._readers
            if one == name
        )

    def connected(self) -> bool:
        """Whether anybody publishes any of the topics that are heard."""
        return any(reader.get_matched_publications() for _, _, reader in self._readers)

    def close(self) -> None:
        """Leave the domain."""
        self._readers.clear()
        self._writers.clear()
        del self._participant


def domain() -> int:
    """The domain that ROS_DOMAIN_ID names; 0 where it is not set. UserError."""
    text = os.environ.get(DOMAIN, "0") or "0"
    if not text.isdecimal() or int(text) > 232:
        raise UserError(f"{DOMAIN} is {text!r}, expected a whole number from 0 to 232")
    return int(text)


def _require() -> None:
    try:
        import cyclonedds  # noqa: F401
    except ImportError as error:
        raise UserError(
            f"ROS 2 needs the package cyclonedds ({error}): install it with `pip install"
            " 'ravenjax[ros2]'`"
        ) from None


def _quality(*, reliable: bool = True, latched: bool = False) -> Any:
    from cyclonedds.core import Policy, Qos
    from cyclonedds.util import duration

    return Qos(
        (
            Policy.Reliability.Reliable(duration(milliseconds=1))
            if reliable
            else Policy.Reliability.BestEffort
        ),
        Policy.Durability.TransientLocal if latched else Policy.Durability.Volatile,
        Policy.History.KeepLast(1 if latched else DEPTH),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )


@cache
def _data_type(kind: str) -> Any:
    """The type for DDS, built from the definition in `messages`; a sample holds the bytes that
    those make.
    """
    from cyclonedds.idl import IdlStruct
    from cyclonedds.idl.annotations import final

    package, _, word = kind.split("/")
    fields = {name: _idl(node) for name, node in messages.types("ros2").store.fielddefs[kind][1]}

    def of(cls: Any, content: bytes) -> Any:
        sample = cls.__new__(cls)
        sample.content = content
        return sample

    def fill(namespace: dict[str, Any]) -> None:
        namespace["__annotations__"] = fields
        namespace["of"] = classmethod(of)

    def deserialize(cls: Any, content: bytes, *_: Any, **__: Any) -> Any:
        return of(cls, bytes(content))

    typename = f"{package}::msg::dds_::{word}_"
    bare: Any = new_class(f"{word}_", (IdlStruct,), {"typename": typename}, fill)
    data: Any = final(dataclass(bare))
    data.serialize = lambda self, *_, **__: self.content
    data.deserialize = classmethod(deserialize)
    return data


def _idl(node: Any) -> Any:
    """The type of a field."""
    from cyclonedds.idl import types
    from rosbags.interfaces import Nodetype

    kind, content = node
    if kind == Nodetype.NAME:
        return _data_type(content)
    if kind == Nodetype.SEQUENCE:
        return types.sequence[_idl(content[0])]
    if kind == Nodetype.ARRAY:
        return types.array[_idl(content[0]), content[1]]
    return {"string": str, "bool": bool}.get(content[0]) or getattr(types, content[0])
