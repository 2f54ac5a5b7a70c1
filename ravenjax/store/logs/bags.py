"""Reads bags of ROS 1 and ROS 2 and MCAP files with the rosbags library, and writes recordings as
bags.

A recording is session.mcap or the trace of a run. It is written as a bag of ROS 1 (.bag) or of ROS
2 (a folder), with the same topics, types and times. In ROS 1 a header has a sequence number, which
is 0, and there is no rcl_interfaces/Log; `/ravenjax/events` has the same events. A trace begins at
time 0, which ROS 1 takes for "no time": its players omit such messages. Therefore all times of a
trace are one second later in a bag of ROS 1.
"""

from __future__ import annotations

import contextlib
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ravenjax.errors import StoreError, UserError
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.store.logs.ros_types import HEADER

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys.store import Typestore

Ros = Literal[1, 2]
SUFFIXES = (".bag", ".mcap", ".db3")
RECORDING = "session.mcap"
"""Name of a recording in the folder of a session."""
ONLY_ROS2 = "rcl_interfaces/msg/Log"
LATER_NS = 1_000_000_000
"""Time that is added in a bag of ROS 1 to a recording that begins at time 0, ns."""
VERSION = 8
"""Version of a bag of ROS 2; the oldest that the library writes."""


class TopicMessages(NamedTuple):
    """The messages of one topic, by time."""

    topic: str
    arrived_ns: np.ndarray  # int64 [n] since the epoch
    # int64 [n]: times in their headers; 0 without headers.
    stamped_ns: np.ndarray
    messages: list[Any]

    @property
    def stamps_run(self) -> bool:
        """Whether headers carry times. If nobody fills them, all are equal."""
        return bool(self.stamped_ns.max() > self.stamped_ns.min())

    @property
    def time_ns(self) -> np.ndarray:
        """Time at which each message was sampled: from its header if headers carry times, else its
        arrival.
        """
        return self.stamped_ns if self.stamps_run else self.arrived_ns


class Joints(NamedTuple):
    """A topic of sensor_msgs/JointState."""

    messages: TopicMessages
    joints: np.ndarray  # [n, 7], rad and m; nan where the messages have no such joint

    @property
    def time_ns(self) -> np.ndarray:
        """Times of the messages."""
        return self.messages.time_ns


def read_joints(path: Path, reader: AnyReader, topic: str) -> Joints:
    """Read joints by the names that ravenjax writes, else seven joints in their order. Raises
    UserError.
    """
    states = read_topic(path, reader, topic)
    first = states.messages[0]
    places = {
        joint: first.name.index(word) for joint, word in enumerate(JOINTS) if word in first.name
    }
    if not places:
        places = dict(enumerate(range(len(JOINTS))))
    joints = np.full((len(states.messages), len(JOINTS)), np.nan)
    try:
        for joint, place in places.items():
            joints[:, joint] = [one.position[place] for one in states.messages]
    except IndexError:
        raise UserError(
            f"{path}: a message of {topic} has other joints than {', '.join(first.name)}; expected"
            f" some of {', '.join(JOINTS)}, or seven in this order"
        ) from None
    return Joints(states, joints)


def read_topic(path: Path, reader: AnyReader, topic: str) -> TopicMessages:
    """Read the messages of one topic. Raises UserError if it has none."""
    connections = [one for one in reader.connections if one.topic == topic]
    arrived, stamped, messages = [], [], []
    for connection, time_ns, data in reader.messages(connections=connections):
        message: Any = reader.deserialize(data, connection.msgtype)
        header = getattr(message, "header", None) or getattr(message, "hdr", None)
        stamped.append(0 if header is None else header.stamp.sec * 10**9 + header.stamp.nanosec)
        arrived.append(time_ns)
        messages.append(message)
    if not messages:
        raise UserError(f"{path}: {topic} has no messages")
    return TopicMessages(topic, np.array(arrived, np.int64), np.array(stamped, np.int64), messages)


@contextlib.contextmanager
def open_bag(path: Path) -> Iterator[AnyReader]:
    """Open a bag or MCAP file and read its definitions. Raises UserError for any damage."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    # Files of ROS 2 may contain no definitions. The usual ones suffice for CRTK.
    usual = get_typestore(Stores.LATEST)
    try:
        with AnyReader([path], default_typestore=usual) as reader:
            yield reader
    except (UserError, StoreError):
        raise
    # The library raises many kinds of errors on damaged files.
    except Exception as error:
        raise UserError(
            f"{path}: no bag or MCAP file that can be read, perhaps truncated:"
            f" {error or type(error).__name__}. Copy or record it again"
        ) from None


class WrittenBag(NamedTuple):
    """A bag that was written, and its size."""

    path: Path
    topics: int
    messages: int
    seconds: float  # from the first message to the last

    def __str__(self) -> str:
        """Return a sentence for the command line."""
        return f"{self.path}: {self.topics} topics, {self.messages} messages, {self.seconds:.3f} s"


def write_bag(source: Path, ros: Ros, out: Path | None = None) -> WrittenBag:
    """Write the bag of a recording, which is an MCAP file of ROS 2 or the folder of a session.

    out: path of the bag; None: beside the recording, with its name and `.bag`, or `_ros2` for the
    folder. Raises UserError if the recording cannot be read or `out` exists, and StoreError if the
    disk refuses.
    """
    recording = source / RECORDING if source.is_dir() else source
    if not recording.is_file() or recording.suffix != ".mcap":
        raise UserError(
            f"{recording}: expected a recording in MCAP that is there: {RECORDING} of a session, or"
            " the .mcap of a traced run"
        )
    target = out or recording.with_name(recording.stem + (".bag" if ros == 1 else "_ros2"))
    if ros == 1 and target.suffix != ".bag":
        raise UserError(
            f"{target}: a bag of ROS 1 ends in .bag; write --out {target.with_suffix('.bag')}"
        )
    if ros == 2 and target.suffix:
        raise UserError(
            f"{target}: a bag of ROS 2 is a folder; write --out {target.with_suffix('')}, or"
            " --ros 1"
        )
    if target.exists():
        raise UserError(
            f"{target}: is there already, and is not overwritten; name another with --out"
        )
    try:
        with open_bag(recording) as reader:
            if not reader.is2 or not reader.message_count:
                raise UserError(f"{recording}: holds no messages of ROS 2")
            try:
                target.parent.mkdir(parents=True, exist_ok=True)
                return _write(reader, ros, target)
            except OSError as error:
                raise StoreError(
                    f"{target}: cannot be written ({error.strerror or error})"
                ) from error
    except BaseException as error:
        # Delete the incomplete bag.
        if target.is_dir():
            shutil.rmtree(target, ignore_errors=True)
        else:
            target.unlink(missing_ok=True)
        if isinstance(error, UserError):
            raise UserError(
                f"{error}. Where it was cut short, first: ravenjax log recover {recording}"
            ) from None
        raise


def _write(reader: AnyReader, ros: Ros, target: Path) -> WrittenBag:
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store, later = reader.typestore, 0
    writer: Any
    if ros == 1:
        # The recording's types with the header of ROS 1.
        header = get_typestore(Stores.ROS1_NOETIC).fielddefs[HEADER]
        store = get_typestore(Stores.EMPTY)
        store.register({**reader.typestore.fielddefs, HEADER: header})
        later = 0 if reader.start_time else LATER_NS
        writer = rosbag1.Writer(target)
    else:
        writer = rosbag2.Writer(target, version=VERSION)
    connections = [one for one in reader.connections if ros == 2 or one.msgtype != ONLY_ROS2]
    messages = 0
    with writer:
        channels = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=store)
            for one in connections
        }
        for one, time_ns, data in reader.messages(connections=connections):
            if later:
                data = _shift(reader.typestore, data, one.msgtype, later)
            if ros == 1:
                data = reader.typestore.cdr_to_ros1(data, one.msgtype)
            writer.write(channels[one.id], time_ns + later, data)
            messages += 1
    seconds = (reader.end_time - 1 - reader.start_time) * 1e-9
    return WrittenBag(target, len(connections), messages, seconds)


def _shift(store: Typestore, data: bytes, kind: str, later: int) -> Any:
    """Return the message with all its stamps later, including those of its transforms."""
    message: Any = store.deserialize_cdr(data, kind)
    for part in (message, *getattr(message, "transforms", ())):
        if hasattr(part, "header"):
            stamp = part.header.stamp
            stamp.sec, stamp.nanosec = divmod(stamp.sec * 10**9 + stamp.nanosec + later, 10**9)
    return store.serialize_cdr(message, kind)
