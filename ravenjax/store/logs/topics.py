"""Defines the topics of MCAP files that traces of runs and training sessions share.

Names are those of CRTK in raven2: gold is arm1, green is arm2. Poses are in frame 0 of their arm,
`armN_frame0`. CRTK's `armN_base` is a different frame. If the orientation of a tip is unknown, the
message is a point.

The names in a message and its size are the same in every tick. Therefore rosbags encodes one
message of each topic, with placeholders for times and numbers. NumPy replaces them in each tick.
"""

import functools
import json
import re
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import IO, Any, NamedTuple

import numpy as np
from mcap.writer import Writer

from ravenjax import resources
from ravenjax.store.logs.ros_types import HEADER, JOINT_STATE, POINT, POSE, WRENCH, MessageTypes
from ravenjax.vocabulary.robot import Robot

ARM_TOPICS = {"gold": "arm1", "green": "arm2"}
"""CRTK's names of the arms of a Raven-II. Arms of other robots keep their names."""
METADATA = "ravenjax"
SIGNALS = "/ravenjax/signals"
"""Topic of the message with a field for every number."""
EVENTS = "/ravenjax/events"
"""Topic of events for programs, one JSON object per message."""
LOG = "/ravenjax/log"
"""Topic with events as readable text, which viewers show as a log."""
FRAMES = "/tf"
WORLD = "world"
TRANSFORMS = "tf2_msgs/msg/TFMessage"
SIGNALS_TYPE = "ravenjax_msgs/msg/Signals"
TEXT, LOG_ENTRY = "std_msgs/msg/String", "rcl_interfaces/msg/Log"
_SECOND_NS = 1_000_000_000
_STAMP_PLACEHOLDER, _FIRST_PLACEHOLDER = 0x5A5A5A5A, 1e6
"""Placeholders in an encoded message: for seconds and nanoseconds of a time, and for the first
number. The placeholder of each further number is larger by 1.
"""

_TABLES = resources.read_tables(__file__, "topics.toml")
_JOINT_STATES, _TIPS = _TABLES["joint_states"], _TABLES["tips"]
LEVELS = _TABLES["levels"]
"""Severities of rcl_interfaces/Log."""
_FRAMES = ("measured", "true", "model")
_FORCE = "haptic_force"
SERIES = {name for names in (*_JOINT_STATES.values(), *_TIPS.values()) for name in names} | {_FORCE}


class Base(NamedTuple):
    """Pose of an arm's base: its frame 0 in the world frame."""

    origin: tuple[float, float, float]  # m
    quaternion: tuple[float, float, float, float]  # x, y, z, w


class Topic(NamedTuple):
    """One topic, with an encoded message into which times and numbers are written."""

    name: str
    schema: str  # type of its messages
    definition: str  # definition of the type, as ros2msg text
    template: bytes = b""  # encoded message
    stamps: tuple[int, ...] = ()  # first byte of each time
    spans: tuple[tuple[int, int], ...] = ()  # first byte and count of consecutive numbers
    size: int = 8  # bytes of a number

    def encode(self, time_ns: np.ndarray, values: np.ndarray) -> dict[int, bytes]:
        """Return messages by tick. time_ns: int64 [T]. values: [T, k] in the order of `spans`.

        A pose, point or frame that is unknown in a tick (a number is NaN) has no message.
        """
        assert sum(count for _, count in self.spans) == values.shape[1]
        ticks = np.arange(len(values))
        if self.schema in (POSE, POINT, TRANSFORMS):
            ticks = np.flatnonzero(np.isfinite(values).all(axis=1))
        times = np.stack(np.divmod(time_ns[ticks], _SECOND_NS), axis=1).astype("<u4")
        filled = np.ascontiguousarray(values[ticks], f"<f{self.size}")
        rows = np.tile(np.frombuffer(self.template, np.uint8), (len(ticks), 1))
        # A time is 8 bytes: seconds and nanoseconds.
        for start in self.stamps:
            rows[:, start : start + 8] = times.view(np.uint8)
        numbers = filled.view(np.uint8)
        copied = 0  # bytes of a tick's numbers that are already in the message
        for start, count in self.spans:
            width = count * self.size
            rows[:, start : start + width] = numbers[:, copied : copied + width]
            copied += width
        return {int(tick): row.tobytes() for tick, row in zip(ticks, rows, strict=True)}


def frame0_name(arm: str) -> str:
    """Return the name of an arm's frame 0, in which all its poses are given."""
    return f"{arm_name(arm)}_frame0"


@functools.cache
def joint_state(arm: str, name: str, joints: tuple[str, ...], *present: bool) -> Topic:
    """Return a topic of JointState. present: whether it has position, velocity and effort."""
    # A field that the messages lack is empty. Placeholders are numbered over the other fields.
    placeholders = iter(np.split(_placeholders(3 * len(joints)), 3))
    fields = [next(placeholders) if is_present else () for is_present in present]
    return _topic(arm, name, JOINT_STATE, list(joints), *fields)


@functools.cache
def tip_topic(arm: str, name: str, schema: str = POSE) -> Topic:
    """Return a topic of an arm. Its numbers are, for PoseStamped, x, y, z in m and a quaternion
    x, y, z, w; for WrenchStamped, three of force and three of torque; for PointStamped, x, y, z.
    """
    xyz = _placeholders(3)
    quaternion, torque = _placeholders(4, first=3), _placeholders(3, first=3)
    fields = {POSE: (xyz, quaternion), WRENCH: (xyz, torque), POINT: xyz}
    return _topic(arm, name, schema, fields[schema])


@functools.cache
def frames_topic(pairs: tuple[tuple[str, str], ...]) -> Topic:
    """Return the topic of frames, a TFMessage. For each pair (parent, child) of names of frames,
    its numbers are x, y, z in m and a quaternion x, y, z, w. The message has placeholders for them.
    """
    transforms = [
        (_header(parent), child, (_placeholders(3, 7 * pair), _placeholders(4, 7 * pair + 3)))
        for pair, (parent, child) in enumerate(pairs)
    ]
    return _template(FRAMES, ros2_types().message(TRANSFORMS, transforms))


def standard_topics(
    robot: Robot, series: Mapping[str, np.ndarray], bases: Mapping[str, Base]
) -> Iterator[tuple[Topic, np.ndarray]]:
    """Yield (topic, numbers [T, k]) of each topic of a standard type for which there are series.
    series: arrays [T, ...] by arm and name, such as gold/jpos. bases: the base of each arm. Without
    a base, the frame 0 of an arm has no parent frame.
    """
    frame_pairs = []
    transforms = []
    for arm in robot.arms:
        of_arm = {
            name.removeprefix(f"{arm}/"): values
            for name, values in series.items()
            if name.startswith(f"{arm}/")
        }
        for name, parts in _JOINT_STATES.items():
            if parts[0] in of_arm:
                values = [of_arm[part] for part in parts if part in of_arm]
                present = [part in of_arm for part in parts]
                topic = joint_state(arm, name, robot.joints, *present)
                yield topic, np.concatenate(values, axis=1)
        if (force := of_arm.get(_FORCE)) is not None:
            values = np.concatenate([force, np.zeros_like(force)], axis=1)
            yield tip_topic(arm, "haptic_cf", WRENCH), values
        poses = {}
        for name, (position, rotation) in _TIPS.items():
            if position in of_arm and rotation in of_arm:
                quaternions = rotation_quaternions(of_arm[rotation].reshape(-1, 3, 3))
                poses[name] = np.concatenate([of_arm[position], quaternions], axis=1, dtype=float)
                yield tip_topic(arm, f"{name}_cp"), poses[name]
            elif position in of_arm:
                yield tip_topic(arm, f"{name}_tip", POINT), of_arm[position].astype(float)
        tips = {name: values for name, values in poses.items() if name in _FRAMES}
        if tips and arm in bases:
            frame_pairs.append((WORLD, frame0_name(arm)))
            base_pose = np.array([*bases[arm].origin, *bases[arm].quaternion])
            ticks = len(next(iter(tips.values())))
            transforms.append(np.broadcast_to(base_pose, (ticks, 7)))
        frame_pairs += [(frame0_name(arm), f"{arm_name(arm)}_tip_{name}") for name in tips]
        transforms += tips.values()
    if frame_pairs:
        yield frames_topic(tuple(frame_pairs)), np.concatenate(transforms, axis=1)


def signals_topic(names: Sequence[str], single: bool = False) -> Topic:
    """Return the topic of a flat message, one number per name: float64, or float32 if `single`."""
    kind, size = ("float32", 4) if single else ("float64", 8)
    fields = "".join(f"{kind} {name}\n" for name in names)
    header_definition = f"{'=' * 80}\nMSG: std_msgs/Header\n{_definition(HEADER)}"
    definition = f"std_msgs/Header header\n{fields}{header_definition}"
    # The message is encoded here, because rosbags would compile an encoder for hundreds of fields.
    head = ros2_types().encode(ros2_types().message(HEADER, *_header("")))
    # CDR aligns numbers from byte 4, the end of its own header, where the time stamp begins: the
    # added bytes make the distance a multiple of a number's size.
    stamp = 4
    head += bytes(-(len(head) - stamp) % size)
    template, spans = head + bytes(size * len(names)), ((len(head), len(names)),)
    return Topic(SIGNALS, SIGNALS_TYPE, definition, template, (stamp,), spans, size)


class LogWriter:
    """Writes an MCAP file in profile ros2, with messages of topics and events."""

    def __init__(
        self,
        file: IO[bytes],
        topics: Iterable[Topic],
        metadata: Mapping[str, str],
        chunk_bytes: int = 1 << 20,
    ):
        """metadata: content of the record `METADATA`. chunk_bytes: size of a chunk. A killed
        process loses one chunk at most.
        """
        self._writer = Writer(file, chunk_size=chunk_bytes)
        self._writer.start(profile="ros2", library="ravenjax")
        self._writer.add_metadata(METADATA, dict(metadata))
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        for topic in topics:
            self._register(topic)

    def add(self, topic: Topic, time_ns: np.ndarray, numbers: np.ndarray, rows: np.ndarray) -> None:
        """Write one message per row of `rows` [n, k], with its time and its sequence number."""
        for row, data in topic.encode(time_ns, rows).items():
            self._add(topic.name, int(time_ns[row]), data, int(numbers[row]))

    def add_event(
        self, event: Mapping[str, Any], text: str, level: str, stamp_ns: int, number: int = 0
    ) -> None:
        """Write an event on EVENTS and LOG. level: one of LEVELS. number: number in sequence."""
        stamp, kind = divmod(stamp_ns, _SECOND_NS), str(event["kind"])
        # An entry has time, severity, name, text, and file, function and line of code (unused).
        log_fields = (stamp, LEVELS[level], kind, text, "", "", 0)
        event_fields = (json.dumps(event),)
        for topic, schema, fields in ((EVENTS, TEXT, event_fields), (LOG, LOG_ENTRY, log_fields)):
            if topic not in self._channels:
                self._register(Topic(topic, schema, _definition(schema)))
            message = ros2_types().message(schema, *fields)
            self._add(topic, stamp_ns, ros2_types().encode(message), number)

    def flush(self) -> None:
        """End the chunk and pass it to the operating system."""
        self._writer.flush()

    def finish(self, metadata: Mapping[str, str] | None = None) -> None:
        """Write the index at the end of the file, after `metadata` if it is given."""
        if metadata:
            self._writer.add_metadata(METADATA, dict(metadata))
        self._writer.finish()

    def _add(self, topic: str, stamp_ns: int, data: bytes, number: int):
        channel = self._channels[topic]
        self._writer.add_message(channel, stamp_ns, data, stamp_ns, number)

    def _register(self, topic: Topic):
        # Adds a topic, and the definition of its message type, to the file.
        if topic.schema not in self._schemas:
            self._schemas[topic.schema] = self._writer.register_schema(
                topic.schema, "ros2msg", topic.definition.encode()
            )
        schema = self._schemas[topic.schema]
        self._channels[topic.name] = self._writer.register_channel(topic.name, "cdr", schema)


def field_name(name: str) -> str:
    """Return a field name that ROS 2 allows: lower case letters, digits, single underscores."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def arm_name(arm: str) -> str:
    """Return an arm's name in topics and frames."""
    return ARM_TOPICS.get(arm) or field_name(arm)


def continuous_turns(quat: np.ndarray) -> np.ndarray:
    """Return quaternions [T, ..., 4] with signs chosen so that each is close to the one before.
    Both signs mean the same rotation.
    """
    # The sign of a quaternion is the product of all changes of sign up to it.
    flips = np.where(np.sum(quat[1:] * quat[:-1], axis=-1, keepdims=True) < 0.0, -1.0, 1.0)
    return np.concatenate([quat[:1], quat[1:] * np.cumprod(flips, axis=0)])


def rotation_quaternions(rotation: np.ndarray) -> np.ndarray:
    """Return unit quaternions x, y, z, w [T, ..., 4] of rotation matrices [T, ..., 3, 3]. Rounding
    errors are removed. A matrix that is no rotation gives NaN. Along the first axis, signs are
    chosen so that quaternions do not jump.
    """
    # The import takes half a second. A real-time program should call this function once before.
    from scipy.spatial.transform import Rotation

    matrices = np.asarray(rotation, float)
    out = np.full((*matrices.shape[:-2], 4), np.nan)
    valid = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))
    valid[valid] = np.linalg.det(matrices[valid]) > 0.0
    if valid.any():
        out[valid] = Rotation.from_matrix(matrices[valid]).as_quat()
    return continuous_turns(out)


@functools.cache
def ros2_types() -> MessageTypes:
    """Return the types of ROS 2."""
    return MessageTypes("ros2")


@functools.cache
def _definition(schema: str) -> str:
    return ros2_types().store.generate_msgdef(schema, ros_version=2)[0]


def _header(frame: str) -> tuple[Any, ...]:
    return (_STAMP_PLACEHOLDER, _STAMP_PLACEHOLDER), frame


def _placeholders(count: int, first: int = 0) -> np.ndarray:
    return _FIRST_PLACEHOLDER + first + np.arange(count)


def _topic(arm: str, name: str, schema: str, *fields) -> Topic:
    message = ros2_types().message(schema, _header(frame0_name(arm)), *fields)
    return _template(f"/{arm_name(arm)}/{name}", message)


def _template(name: str, message) -> Topic:
    # Encodes a message, and finds the bytes of its numbers and times, which are placeholders:
    # number k is `_FIRST_PLACEHOLDER` + k.
    template, spans = ros2_types().encode(message), []
    number = 0
    while (encoded := struct.pack("<d", _FIRST_PLACEHOLDER + number)) in template:
        position = template.index(encoded)
        start, count = spans[-1] if spans else (0, 0)
        # Adjacent numbers, of 8 bytes each, are one span. Position 0 is the header of CDR.
        if position == start + 8 * count:
            spans[-1] = start, count + 1
        else:
            spans.append((position, 1))
        number += 1
    stamp = struct.pack("<II", _STAMP_PLACEHOLDER, _STAMP_PLACEHOLDER)
    stamps = tuple(match.start() for match in re.finditer(re.escape(stamp), template))
    schema = message.__msgtype__
    return Topic(name, schema, _definition(schema), template, stamps, tuple(spans))
