"""Reads ROS bags and MCAP files with the rosbags library, and writes recordings as bags.

A recording is session.mcap of a training session, or the trace of a run. It is written as a bag of
ROS 1 (.bag) or of ROS 2 (a folder), with the same topics and types.

In ROS 1 a header has a sequence number, which is 0, and there is no rcl_interfaces/Log;
`/ravenjax/events` has the same events. Times are kept, except those of a trace in a bag of ROS 1.
They are one second later, because a trace begins at time 0, and players of ROS 1 omit messages of
time 0.
"""

import contextlib
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NamedTuple

import numpy as np

from ravenjax import resources
from ravenjax.errors import StoreError, UserError
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.store import files
from ravenjax.store.logs.ros_types import HEADER

if TYPE_CHECKING:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys.store import Typestore

Ros = Literal[1, 2]
SUFFIXES = (".bag", ".mcap", ".db3")
DAY_NS = 86_400_000_000_000
_NAME = re.compile(r"^(gold|green|arm[12])_|_joint|_[lr]$")
RAVEN2_NAMES = resources.read_tables(__file__, "bags.toml")["raven2_names"]
"""Names of joints in raven2's messages that differ from ravenjax's names, without the arm."""
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
    clock: str  # source of the times, as text
    time_ns: np.ndarray  # int64 [n], time since 1970
    number: np.ndarray  # [n], number of the message in its topic, from 0
    messages: list[Any]
    notes: tuple[str, ...]


def read_topic(path: Path, reader: "AnyReader", topic: str, stamped: bool) -> TopicMessages:
    """Read the messages of one topic. Raise UserError if there are none. Times are those of the
    message headers. They are times of arrival if `stamped` is False, or if all headers have the
    same time. A message with time 0 was sent before the sender knew the time. If the other times
    count from 1970, such messages are left out, with a note.
    """
    connections = [one for one in reader.connections if one.topic == topic]
    arrived, stamps, messages = [], [], []
    for connection, time_ns, data in reader.messages(connections=connections):
        message: Any = reader.deserialize(data, connection.msgtype)
        header = getattr(message, "header", None) or getattr(message, "hdr", None)
        stamps.append(0 if header is None else header.stamp.sec * 10**9 + header.stamp.nanosec)
        arrived.append(time_ns)
        messages.append(message)
    if not messages:
        raise UserError(f"{path}: {topic} has no messages")
    stamp_ns, number = np.array(stamps, np.int64), np.arange(len(messages))
    if not stamped or stamp_ns.max() == stamp_ns.min():
        times = np.array(arrived, np.int64)
        return TopicMessages(topic, f"log times of {topic}", times, number, messages, ())
    notes: tuple[str, ...] = ()
    timed = stamp_ns != 0
    # Times since 1970 exceed a day. A trace of a run counts from 0, so its first time is right.
    if not timed.all() and stamp_ns[timed].min() > DAY_NS:
        first, next_s = int(np.argmin(timed)), stamp_ns[timed][0] * 1e-9
        notes = (
            f"message {first} of {topic} has time 0, and the next message {next_s:.4g} s: all"
            f" messages with time 0 ({(~timed).sum()}) are left out",
        )
        stamp_ns, number = stamp_ns[timed], number[timed]
        messages = [messages[i] for i in number]
    return TopicMessages(topic, f"header stamps of {topic}", stamp_ns, number, messages, notes)


def read_joints(path: Path, states: TopicMessages) -> np.ndarray:
    """Return joint positions [n, 7] of sensor_msgs/JointState, rad and m. A joint that no message
    has is NaN. Names are those of ravenjax or of raven2. A message without names has the seven
    joints in order. Raise UserError for other names, or if a message lacks a joint that others
    have.
    """
    joints = np.full((len(states.messages), len(JOINTS)), np.nan)
    for row, (number, state) in enumerate(zip(states.number, states.messages, strict=True)):
        # Without the name of the arm, which may be at the begin or the end: gold_elbow, elbow_l.
        names = [_NAME.sub("", name.lower()) for name in state.name]
        names = [RAVEN2_NAMES.get(name, name) for name in names] or list(JOINTS)
        present = [name for name in names if name in JOINTS]
        if not present or len(set(present)) < len(present) or len(state.position) > len(names):
            raise UserError(
                f"{path}: message {number} of {states.topic} has {len(state.position)} positions of"
                f" {', '.join(state.name) or 'joints without names'}; expected names of joints,"
                f" none twice, or no names and seven positions in the order {', '.join(JOINTS)}"
            )
        for name, position in zip(names, state.position, strict=False):
            if name in JOINTS:
                joints[row, JOINTS.index(name)] = position
    # An infinite position counts as lacking. A joint that no message has is permitted.
    lacks = ~np.isfinite(joints) & ~np.isnan(joints).all(axis=0)
    if lacks.any():
        row = int(np.argmax(lacks.any(axis=1)))
        raise UserError(
            f"{path}: message {states.number[row]} of {states.topic} lacks"
            f" {', '.join(JOINTS[joint] for joint in np.flatnonzero(lacks[row]))}, which other"
            f" messages have. Remove such messages ({lacks.any(axis=1).sum()} in all) from the file"
        )
    return joints


def is_bag(path: Path) -> bool:
    """Return whether a path is a bag or an MCAP file, or the folder of a bag of ROS 2."""
    return (path / "metadata.yaml").is_file() or path.suffix.lower() in SUFFIXES


@contextlib.contextmanager
def open_bag(path: Path) -> "Iterator[AnyReader]":
    """Open a bag or MCAP file and read its definitions. Raise UserError for a damaged file."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    for file in path.iterdir() if path.is_dir() else [path]:
        if is_bag(file):
            files.require_content(file)
    # Files of ROS 2 may contain no definitions of types. CRTK needs only standard types.
    usual = get_typestore(Stores.LATEST)
    try:
        with AnyReader([path], default_typestore=usual) as reader:
            yield reader
    except (UserError, StoreError):
        raise
    # The library raises many kinds of errors on damaged files.
    except Exception as error:
        raise UserError(
            f"{path}: cannot be read as a bag or MCAP file, perhaps because it is truncated:"
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


def write_bag(source: Path, ros: Ros, out: Path | None) -> WrittenBag:
    """Write the bag of a recording, which is an MCAP file of ROS 2 or the folder of a session. out:
    path of the bag. The default is beside the recording, with its name and the ending `.bag` or
    `_ros2`. Raise UserError if the recording is unreadable or `out` exists, StoreError if it cannot
    be written.
    """
    recording = source / RECORDING if source.is_dir() else source
    if not recording.is_file() or recording.suffix != ".mcap":
        raise UserError(
            f"{recording}: expected an existing MCAP file: {RECORDING} of a session, or the .mcap"
            " of a traced run"
        )
    target = out or recording.with_name(recording.stem + (".bag" if ros == 1 else "_ros2"))
    if ros == 1 and target.suffix != ".bag":
        raise UserError(f"{target}: a bag ends in .bag; write --out {target.with_suffix('.bag')}")
    if ros == 2 and target.suffix:
        raise UserError(
            f"{target}: a ROS 2 bag is a folder; write --out {target.with_suffix('')}, or --ros 1"
        )
    if target.exists():
        raise UserError(f"{target}: exists already; choose another name with --out")
    try:
        with open_bag(recording) as reader:
            if not reader.is2 or not reader.message_count:
                raise UserError(f"{recording}: contains no messages of ROS 2")
            with files.disk_errors(f"{target}: cannot be written"):
                target.parent.mkdir(parents=True, exist_ok=True)
                return _write(reader, ros, target)
    except BaseException as error:
        # Delete the incomplete bag.
        if target.is_dir():
            shutil.rmtree(target, ignore_errors=True)
        else:
            target.unlink(missing_ok=True)
        if isinstance(error, UserError):
            raise UserError(
                f"{error}. If the recording is truncated, first run: ravenjax log recover"
                f" {recording}"
            ) from None
        raise


def _write(reader: "AnyReader", ros: Ros, target: Path) -> WrittenBag:
    # Copies all messages. ROS 1 needs its own header type, and times after 0.
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    store = reader.typestore
    later = 0  # ns, added to all times
    writer: Any
    if ros == 1:
        # Uses the message types of the recording, with the header of ROS 1.
        header = get_typestore(Stores.ROS1_NOETIC).fielddefs[HEADER]
        store = get_typestore(Stores.EMPTY)
        store.register({**reader.typestore.fielddefs, HEADER: header})
        later = 0 if reader.start_time else LATER_NS
        writer = rosbag1.Writer(target)
    else:
        writer = rosbag2.Writer(target, version=VERSION)
    sources = [one for one in reader.connections if ros == 2 or one.msgtype != ONLY_ROS2]
    messages = 0
    with writer:
        targets = {
            source.id: writer.add_connection(source.topic, source.msgtype, typestore=store)
            for source in sources
        }
        for source, time_ns, data in reader.messages(connections=sources):
            if later:
                data = _shift(reader.typestore, data, source.msgtype, later)
            if ros == 1:
                data = reader.typestore.cdr_to_ros1(data, source.msgtype)
            writer.write(targets[source.id], time_ns + later, data)
            messages += 1
    # The library's `end_time` is 1 ns after the last message.
    seconds = (reader.end_time - 1 - reader.start_time) * 1e-9
    return WrittenBag(target, len(sources), messages, seconds)


def _shift(store: "Typestore", data: bytes, kind: str, later: int) -> Any:
    # Returns a serialized message with all time stamps, also of its transforms, `later` ns later.
    message: Any = store.deserialize_cdr(data, kind)
    for part in (message, *getattr(message, "transforms", ())):
        if hasattr(part, "header"):
            stamp = part.header.stamp
            stamp.sec, stamp.nanosec = divmod(stamp.sec * 10**9 + stamp.nanosec + later, 10**9)
    return store.serialize_cdr(message, kind)
