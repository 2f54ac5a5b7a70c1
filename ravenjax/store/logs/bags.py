"""Reads bags of ROS 1 and ROS 2, and MCAP files of either, by the rosbags library; and writes a
recording, session.mcap or the trace of a run, as a bag: of ROS 1 (.bag) or of ROS 2 (a folder).

In a written bag topics, types and times are those of the recording. In ROS 1 a header has a number,
which is 0, and there is no rcl_interfaces/Log: `/ravenjax/events` has the same events. A trace
begins at time 0, which ROS 1 takes for "no time" (its players leave such messages out): all its
times are one second later there.
"""

from __future__ import annotations

import contextlib
import shutil
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ravenjax.errors import StoreError, UserError
from ravenjax.robots.raven2.arms import JOINTS

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys.store import Typestore

Ros = Literal[1, 2]
SUFFIXES = (".bag", ".mcap", ".db3")
RECORDING = "session.mcap"
"""Name of a recording in the folder of a session."""
HEADER, ONLY_ROS2 = "std_msgs/msg/Header", "rcl_interfaces/msg/Log"
LATER_NS = 1_000_000_000
"""By so much a recording that begins at time 0 is later in a bag of ROS 1."""
VERSION = 8
"""Of a bag of ROS 2; the oldest that the library writes."""


class TopicMessages(NamedTuple):
    """The messages of one topic, by time."""

    topic: str
    arrived_ns: np.ndarray  # int64 [n] since the epoch
    stamped_ns: np.ndarray  # int64 [n] as their headers say; 0 where there are none
    messages: list[Any]

    @property
    def stamps_run(self) -> bool:
        """Whether headers carry times: where nobody fills them they are all alike."""
        return bool(self.stamped_ns.max() > self.stamped_ns.min())

    @property
    def time_ns(self) -> np.ndarray:
        """When each message was sampled: by its header, where headers carry times."""
        return self.stamped_ns if self.stamps_run else self.arrived_ns


class Joints(NamedTuple):
    """A topic of sensor_msgs/JointState."""

    messages: TopicMessages
    joints: np.ndarray  # [n, 7], rad and m; nan where the messages have no such joint

    @property
    def time_ns(self) -> np.ndarray:
        """As of its messages."""
        return self.messages.time_ns


def read_joints(path: Path, reader: AnyReader, topic: str) -> Joints:
    """Joints by the names that ravenjax writes, else seven in their order. UserError."""
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
    """The messages of one topic. UserError where it has none."""
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
    """The file, its definitions read; whatever is wrong with it is a UserError."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    # of files of ROS 2 that hold no definitions: enough for CRTK
    usual = get_typestore(Stores.LATEST)
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
            f"{path}: no bag or MCAP file that can be read, perhaps truncated:"
            f" {error or type(error).__name__}. Copy or record it again"
        ) from None


def _damage() -> tuple[type[Exception], ...]:
    """What a file that is cut, damaged or of another kind makes the library raise."""
    import apsw
    from rosbags.highlevel import AnyReaderError
    from rosbags.rosbag1 import ReaderError as Ros1Error
    from rosbags.rosbag2 import ReaderError as Ros2Error
    from rosbags.serde import SerdeError
    from rosbags.typesys.base import TypesysError

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
    library = AnyReaderError, Ros1Error, Ros2Error, SerdeError, TypesysError
    return *library, apsw.Error, struct.error, *plain


class WrittenBag(NamedTuple):
    """What was written."""

    path: Path
    topics: int
    messages: int
    seconds: float  # from the first message to the last

    def __str__(self) -> str:
        """In words, for the command line."""
        return f"{self.path}: {self.topics} topics, {self.messages} messages, {self.seconds:.3f} s"


def write_bag(source: Path, ros: Ros, out: Path | None = None) -> WrittenBag:
    """The bag of a recording: an MCAP file of ROS 2, or the folder of a session.

    out: default beside the recording, its name with `.bag`, or with `_ros2` for the folder.
    UserError where the recording cannot be read or `out` is there already, StoreError where the
    disk refuses.
    """
    recording = source / RECORDING if source.is_dir() else source
    if not recording.is_file():
        raise UserError(
            f"{recording}: no such file; expected the {RECORDING} of a session or the .mcap of a"
            " traced run"
        )
    if recording.suffix != ".mcap":
        raise UserError(
            f"{recording}: expected a recording in MCAP: {RECORDING} of a session, or the .mcap of"
            " a traced run"
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
    with _readable(recording) as reader, _removed_on_failure(target):
        return (_ros1 if ros == 1 else _ros2)(reader, target)


@contextlib.contextmanager
def _readable(recording: Path) -> Iterator[AnyReader]:
    """The recording, opened; one that was cut short is told how it is made whole."""
    with contextlib.ExitStack() as stack:
        try:
            reader = stack.enter_context(open_bag(recording))
        except UserError as error:
            raise UserError(
                f"{error}. Where it was cut short, first: ravenjax log recover {recording}"
            ) from None
        if not reader.is2 or not reader.message_count:
            raise UserError(
                f"{recording}: holds no messages of ROS 2; expected a recording of ravenjax"
            )
        yield reader


@contextlib.contextmanager
def _removed_on_failure(target: Path) -> Iterator[None]:
    """No half a bag is left; what the disk refuses is a StoreError."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        yield
    except BaseException as error:
        if target.is_dir():
            shutil.rmtree(target, ignore_errors=True)
        else:
            target.unlink(missing_ok=True)
        if isinstance(error, OSError):
            raise StoreError(f"{target}: cannot be written ({error.strerror or error})") from error
        raise


def _ros2(reader: AnyReader, target: Path) -> WrittenBag:
    from rosbags.rosbag2 import Writer

    with Writer(target, version=VERSION) as writer:
        channels = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=reader.typestore)
            for one in reader.connections
        }
        for one, time_ns, data in reader.messages():
            writer.write(channels[one.id], time_ns, data)
    return _written(reader, target, len(channels), reader.message_count)


def _ros1(reader: AnyReader, target: Path) -> WrittenBag:
    from rosbags.rosbag1 import Writer

    store = _ros1_types(reader)
    later = 0 if reader.start_time else LATER_NS
    connections = [one for one in reader.connections if one.msgtype != ONLY_ROS2]
    encode = {
        kind: _encoder(reader, store, kind, later) for kind in {one.msgtype for one in connections}
    }
    messages = 0
    with Writer(target) as writer:
        channels = {
            one.id: writer.add_connection(one.topic, one.msgtype, typestore=store)
            for one in connections
        }
        for one, time_ns, data in reader.messages(connections=connections):
            writer.write(channels[one.id], time_ns + later, encode[one.msgtype](data))
            messages += 1
    return _written(reader, target, len(connections), messages)


def _ros1_types(reader: AnyReader) -> Typestore:
    """The recording's types with the header of ROS 1."""
    from rosbags.typesys import Stores, get_typestore

    header = get_typestore(Stores.ROS1_NOETIC).fielddefs[HEADER]
    store = get_typestore(Stores.EMPTY)
    store.register({**reader.typestore.fielddefs, HEADER: header})
    return store


def _encoder(reader: AnyReader, store: Typestore, kind: str, later: int) -> Callable[[bytes], Any]:
    """What makes a message of ROS 1 of one of ROS 2."""
    if not later:  # the numbers are the same bytes
        return lambda data: reader.typestore.cdr_to_ros1(data, kind)

    def shifted(data: bytes) -> Any:
        message: Any = reader.typestore.deserialize_cdr(data, kind)
        for stamp in _stamps(message):
            stamp.sec, stamp.nanosec = divmod(stamp.sec * 10**9 + stamp.nanosec + later, 10**9)
        return reader.typestore.cdr_to_ros1(reader.typestore.serialize_cdr(message, kind), kind)

    return shifted


def _stamps(message: Any) -> Iterator[Any]:
    """The stamps of its headers: its own, and those of its transforms."""
    for one in (message, *getattr(message, "transforms", ())):
        if hasattr(one, "header"):
            yield one.header.stamp


def _written(reader: AnyReader, target: Path, topics: int, messages: int) -> WrittenBag:
    return WrittenBag(target, topics, messages, (reader.end_time - 1 - reader.start_time) * 1e-9)
