"""MCAP logs as other tools read them: decoded by the mcap library's ROS 2 support, which knows
only the file.
"""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory


class Message(NamedTuple):
    """One message."""

    time_ns: int
    number: int  # sequence number
    value: Any  # attributes as the schema names them


class Log(NamedTuple):
    """A whole file."""

    topics: dict[str, list[Message]]
    kinds: dict[str, str]  # topic -> name of its schema
    schemas: dict[str, str]  # name -> text
    metadata: dict[str, dict[str, str]]

    def column(self, topic: str, *path: str) -> np.ndarray:
        """A field of all messages of a topic, [messages] or [messages, k]: of a point or
        quaternion its numbers.
        """
        return np.array([_number(_field(message.value, path)) for message in self.topics[topic]])


def read(path: Path) -> Log:
    """Every message of a file of profile ros2, encoded as ros2msg and cdr."""
    topics: dict[str, list[Message]] = {}
    kinds: dict[str, str] = {}
    schemas: dict[str, str] = {}
    with open(path, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        for schema, channel, message, value in reader.iter_decoded_messages():
            assert (schema.encoding, channel.message_encoding) == ("ros2msg", "cdr")
            kinds[channel.topic], schemas[schema.name] = schema.name, schema.data.decode()
            topics.setdefault(channel.topic, []).append(
                Message(message.log_time, message.sequence, value)
            )
        metadata = {record.name: record.metadata for record in reader.iter_metadata()}
    return Log(topics, kinds, schemas, metadata)


def fields(value: Any) -> list[str]:
    """Names of a message's fields, in order."""
    return list(value.__slots__)


def _field(value: Any, path: tuple[str, ...]) -> Any:
    for name in path:
        value = getattr(value, name)
    return value


def _number(value: Any) -> Any:
    names = getattr(value, "__slots__", None)
    return [getattr(value, name) for name in names] if names else value
