"""Opens bags of ROS 1 and ROS 2, and MCAP files of either, by the rosbags library."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ravenjax.errors import UserError

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader


def messages_of(reader: AnyReader, topic: str) -> tuple[np.ndarray, list[Any]]:
    """When each message of a topic arrived, ns since the epoch [n], and the messages."""
    connections = [one for one in reader.connections if one.topic == topic]
    received, messages = [], []
    for connection, time_ns, data in reader.messages(connections=connections):
        received.append(time_ns)
        messages.append(reader.deserialize(data, connection.msgtype))
    return np.array(received, np.int64), messages


@contextlib.contextmanager
def opened(path: Path) -> Iterator[AnyReader]:
    """The file, its definitions read; whatever is wrong with it is a UserError."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    usual = get_typestore(
        Stores.LATEST
    )  # of files of ROS 2 that hold no definitions: enough for CRTK
    try:
        with contextlib.ExitStack() as stack:
            try:
                reader = stack.enter_context(AnyReader([path], default_typestore=usual))
            except (
                TypeError,
                AttributeError,
            ) as error:  # metadata.yaml has other things than the library expects
                raise UserError(
                    f"{path}: no bag that can be read, its metadata are damaged: {error}"
                ) from None
            yield reader
    except UserError:
        raise
    except _damage() as error:
        raise UserError(
            f"{path}: no bag or MCAP file that can be read: {error or type(error).__name__}"
        ) from None


def _damage() -> tuple[type[Exception], ...]:
    """What a file that is cut, damaged or of another kind makes the library raise."""
    import apsw
    from rosbags.highlevel import AnyReaderError
    from rosbags.rosbag1 import ReaderError as Ros1Error
    from rosbags.rosbag2 import ReaderError as Ros2Error

    plain = (
        OSError,
        ValueError,
        LookupError,
        AssertionError,
        RuntimeError,
        EOFError,
        OverflowError,
        MemoryError,
    )
    return AnyReaderError, Ros1Error, Ros2Error, apsw.Error, struct.error, *plain
