"""Topics of MCAP logs: name, type and messages of those that a trace and a session share.

Names are CRTK's as raven2 has them: gold is arm1, green arm2. Poses are in frame 0 of their arm,
which is the frame `armN_base`. An orientation that nobody knows is not published: where there is
none the message is a point.

Names and sizes of a log's messages do not change from tick to tick. So rosbags encodes one message
of each topic, with marks in place of times and numbers, and numpy fills in those of all ticks.
"""

from __future__ import annotations

import functools
import json
import re
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from mcap.writer import Writer

from ravenjax.vocabulary.robot import Robot

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

ARM_TOPICS = {"gold": "arm1", "green": "arm2"}
"""CRTK's names of the arms of a Raven-II; an arm of another robot keeps its own."""
SIGNALS = "/ravenjax/signals"
"""The flat message: every scalar under a name of its own."""
EVENTS = "/ravenjax/events"
"""What happened, one JSON object a message, for programs."""
LOG = "/ravenjax/log"
"""The same in words, for people: viewers show it as a log."""
FRAMES = "/tf"
WORLD = "world"
LEVELS = {"debug": 10, "info": 20, "warn": 30, "error": 40, "fatal": 50}
"""Severities of rcl_interfaces/Log."""

HEADER, POSE, POINT = (
    "std_msgs/msg/Header",
    "geometry_msgs/msg/PoseStamped",
    "geometry_msgs/msg/PointStamped",
)
JOINT_STATE, TRANSFORMS = "sensor_msgs/msg/JointState", "tf2_msgs/msg/TFMessage"
_SIGNALS_TYPE, _TEXT, _LOG_ENTRY = (
    "ravenjax_msgs/msg/Signals",
    "std_msgs/msg/String",
    "rcl_interfaces/msg/Log",
)
_SECOND_NS = 1_000_000_000
_STAMP_MARK, _FIRST_MARK = 0x5A5A5A5A, 1e6
"""In a template: seconds and nanoseconds of a time, and the first number; the next is one more."""


_JOINT_STATES = {
    "measured_js": ("jpos", "jvel", None),
    "setpoint_js": ("jpos_d", None, "tau_d"),
    "true_js": ("link_jpos", "link_jvel", None),
    "model_js": ("model_jpos", None, None),
}
_TIPS = {
    "measured": ("position", "rotation"),
    "setpoint": ("position_d", "rotation_d"),
    "true": ("tip", "tip_rotation"),
    "model": ("model_position", "model_rotation"),
    "golden": ("golden_tip", "golden_rotation"),
}
_FRAMES = ("measured", "true", "model")
_FORCE = "haptic_force"
SERIES = {name for names in (*_JOINT_STATES.values(), *_TIPS.values()) for name in names} | {_FORCE}


class Base(NamedTuple):
    """Where an arm stands: its frame 0 in the world."""

    origin: tuple[float, float, float]  # m
    quaternion: tuple[float, float, float, float]  # x, y, z, w


@dataclass(frozen=True, eq=False)
class Topic:
    """One topic, and a message of it whose times and numbers are filled in."""

    name: str
    schema: str
    definition: str  # ros2msg text of the schema
    template: bytes = b""
    stamps: tuple[int, ...] = ()  # first byte of each time
    spans: tuple[tuple[int, int], ...] = ()  # of numbers in a row: first byte, how many
    size: int = 8  # bytes of a number

    def encode(self, time_ns: np.ndarray, values: np.ndarray) -> dict[int, bytes]:
        """Messages by tick: `time_ns` int64 [T], `values` [T, k]. Of a pose, point or frame that
        is not known in a tick (a number is none) there is no message then.
        """
        assert sum(count for _, count in self.spans) == values.shape[1]
        ticks = np.arange(len(values))
        if self.schema in (POSE, POINT, TRANSFORMS):
            ticks = np.flatnonzero(np.isfinite(values).all(axis=1))
        times = np.stack(np.divmod(time_ns[ticks], _SECOND_NS), axis=1).astype("<u4")
        filled = np.ascontiguousarray(values[ticks], f"<f{self.size}")
        rows = np.tile(np.frombuffer(self.template, np.uint8), (len(ticks), 1))
        for start in self.stamps:
            rows[:, start : start + 8] = times.view(np.uint8)
        numbers = filled.view(np.uint8)
        at = 0
        for start, count in self.spans:
            width = count * self.size
            rows[:, start : start + width] = numbers[:, at : at + width]
            at += width
        return {int(tick): row.tobytes() for tick, row in zip(ticks, rows, strict=True)}


def base(arm: str) -> str:
    """Name of the frame that all poses of an arm are in, its frame 0."""
    return f"{arm_name(arm)}_base"


def tip(arm: str, which: str) -> str:
    """Name of the frame of an arm's jaws: `which` is measured, true or model."""
    return f"{arm_name(arm)}_tip_{which}"


@functools.cache
def joint_state(
    arm: str,
    name: str,
    joints: tuple[str, ...],
    position: bool = True,
    velocity: bool = False,
    effort: bool = False,
) -> Topic:
    """sensor_msgs/JointState of the joints: those of position, velocity, effort that there are,
    in this order.
    """
    marks = np.split(_marks(3 * len(joints)), 3)
    filled = [marks.pop(0) if there else np.zeros(0) for there in (position, velocity, effort)]
    message = _message(JOINT_STATE, _header(base(arm)), list(joints), *filled)
    return _topic(f"/{arm_name(arm)}/{name}", message)


@functools.cache
def pose(arm: str, name: str) -> Topic:
    """geometry_msgs/PoseStamped: x, y, z in m and a quaternion x, y, z, w."""
    place, turn = _place("Point"), _message("geometry_msgs/msg/Quaternion", *_marks(4, 3))
    inner = _message("geometry_msgs/msg/Pose", place, turn)
    return _topic(f"/{arm_name(arm)}/{name}", _message(POSE, _header(base(arm)), inner))


@functools.cache
def point(arm: str, name: str) -> Topic:
    """geometry_msgs/PointStamped: x, y, z in m, of a tip whose orientation is not known."""
    message = _message(POINT, _header(base(arm)), _place("Point"))
    return _topic(f"/{arm_name(arm)}/{name}", message)


@functools.cache
def wrench(arm: str, name: str) -> Topic:
    """geometry_msgs/WrenchStamped: three of force, three of torque."""
    inner = _message("geometry_msgs/msg/Wrench", _place("Vector3"), _place("Vector3", 3))
    message = _message("geometry_msgs/msg/WrenchStamped", _header(base(arm)), inner)
    return _topic(f"/{arm_name(arm)}/{name}", message)


@functools.cache
def frames(pairs: tuple[tuple[str, str], ...]) -> Topic:
    """tf2_msgs/TFMessage: of each (parent, child) the place x, y, z in m and the quaternion x,
    y, z, w.
    """
    transforms = []
    for i, (parent, child) in enumerate(pairs):
        place = _place("Vector3", 7 * i)
        turn = _message("geometry_msgs/msg/Quaternion", *_marks(4, 7 * i + 3))
        transform = _message("geometry_msgs/msg/Transform", place, turn)
        kind = "geometry_msgs/msg/TransformStamped"
        transforms.append(_message(kind, _header(parent), child, transform))
    return _topic(FRAMES, _message(TRANSFORMS, transforms))


def standard(
    robot: Robot, series: Mapping[str, np.ndarray], bases: Mapping[str, Base]
) -> Iterator[tuple[Topic, np.ndarray]]:
    """The topics with types of their own that series [T, ...] of arms fill, and the numbers [T, k]
    of each; bases: of each arm, without one its base is the root of its frames.
    """
    pairs: list[tuple[str, str]] = []
    places: list[np.ndarray] = []
    for arm in robot.arms:
        own = {
            name.removeprefix(f"{arm}/"): values
            for name, values in series.items()
            if name.startswith(f"{arm}/")
        }
        for name, parts in _JOINT_STATES.items():
            if parts[0] in own:
                values = [own[part] for part in parts if part in own]
                present = [part in own for part in parts]
                topic = joint_state(arm, name, robot.joints, *present)
                yield topic, np.concatenate(values, axis=1)
        if (force := own.get(_FORCE)) is not None:
            values = np.concatenate([force, np.zeros_like(force)], axis=1)
            yield wrench(arm, "haptic_cf"), values
        poses = {}
        for name, (place, rotation) in _TIPS.items():
            if place in own and rotation in own:
                turns = quaternions(own[rotation].reshape(-1, 3, 3))
                poses[name] = np.concatenate([own[place], turns], axis=1, dtype=float)
                yield pose(arm, f"{name}_cp"), poses[name]
            elif place in own:
                yield point(arm, f"{name}_tip"), own[place].astype(float)
        tips = {name: values for name, values in poses.items() if name in _FRAMES}
        if tips and arm in bases:
            pairs.append((WORLD, base(arm)))
            row = np.array([*bases[arm].origin, *bases[arm].quaternion])
            places.append(np.broadcast_to(row, (len(next(iter(tips.values()))), 7)))
        pairs += [(base(arm), tip(arm, name)) for name in tips]
        places += tips.values()
    if pairs:
        yield frames(tuple(pairs)), np.concatenate(places, axis=1)


def signals(names: Sequence[str], single: bool = False) -> Topic:
    """The flat message of one number per name: float64, or float32 if `single`."""
    kind, size = ("float32", 4) if single else ("float64", 8)
    fields = "".join(f"{kind} {name}\n" for name in names)
    needed = f"{'=' * 80}\nMSG: std_msgs/Header\n{_definition(HEADER)}"
    # A header and numbers behind it; rosbags would compile an encoder of some hundred fields.
    head = _encoded(_header(""))
    head += bytes(-(len(head) - 4) % size)
    template, spans = head + bytes(size * len(names)), ((len(head), len(names)),)
    definition = f"std_msgs/Header header\n{fields}{needed}"
    return Topic(SIGNALS, _SIGNALS_TYPE, definition, template, (4,), spans, size)


def events() -> tuple[Topic, Topic]:
    """std_msgs/String and rcl_interfaces/Log; their messages are `encoded_event`'s."""
    return Topic(EVENTS, _TEXT, _definition(_TEXT)), Topic(LOG, _LOG_ENTRY, _definition(_LOG_ENTRY))


def encoded_event(
    event: Mapping[str, Any], text: str, level: str, stamp_ns: int
) -> tuple[bytes, bytes]:
    """An event as messages of the two topics of `events`. `level` is one of LEVELS."""
    time = _message("builtin_interfaces/msg/Time", *divmod(stamp_ns, _SECOND_NS))
    entry = _message(_LOG_ENTRY, time, LEVELS[level], str(event["kind"]), text, "", "", 0)
    return _encoded(_message(_TEXT, json.dumps(event))), _encoded(entry)


def event_of(message: bytes) -> dict[str, Any]:
    """The event of a message on EVENTS."""
    text: Any = _typestore().deserialize_cdr(message, _TEXT)
    return json.loads(text.data)


def register(writer: Writer, topics: Iterable[Topic]) -> list[int]:
    """Tell the writer of the topics; the channel number of each."""
    schemas: dict[str, int] = {}
    channels = []
    for topic in topics:
        if topic.schema not in schemas:
            schemas[topic.schema] = writer.register_schema(
                topic.schema, "ros2msg", topic.definition.encode()
            )
        channels.append(writer.register_channel(topic.name, "cdr", schemas[topic.schema]))
    return channels


def field(name: str) -> str:
    """A field name as ROS 2 allows it: lower case letters, digits, single underscores."""
    return re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")


def arm_name(arm: str) -> str:
    """What an arm is called in topics and frames."""
    return ARM_TOPICS.get(arm) or field(arm)


def quaternions(rotation: np.ndarray) -> np.ndarray:
    """Unit quaternions x, y, z, w [T, ..., 4] of rotations [T, ..., 3, 3]; NaN where a matrix is no
    rotation.

    A matrix that is a rotation up to rounding, as control software in single precision holds it,
    gives the nearest one. The sign is kept from tick to tick, so that a curve of it has no jumps.
    """
    # half a second to import: who must not wait calls this once before
    from scipy.spatial.transform import Rotation

    matrices = np.asarray(rotation, float)
    out = np.full((*matrices.shape[:-2], 4), np.nan)
    valid = np.asarray(np.isfinite(matrices).all(axis=(-2, -1)))
    valid[valid] = np.linalg.det(matrices[valid]) > 0.0
    if valid.any():
        out[valid] = Rotation.from_matrix(matrices[valid]).as_quat()
    flips = np.where(np.sum(out[1:] * out[:-1], axis=-1) < 0.0, -1.0, 1.0)
    out[1:] *= np.cumprod(flips, axis=0)[..., None]
    return out


@functools.cache
def _typestore() -> Typestore:
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_HUMBLE)


@functools.cache
def _definition(schema: str) -> str:
    return _typestore().generate_msgdef(schema, ros_version=2)[0]


def _message(schema: str, *fields: Any) -> Any:
    return _typestore().types[schema](*fields)


def _encoded(message: Any) -> bytes:
    return bytes(_typestore().serialize_cdr(message, message.__msgtype__))


def _header(frame: str) -> Any:
    time = _message("builtin_interfaces/msg/Time", _STAMP_MARK, _STAMP_MARK)
    return _message(HEADER, time, frame)


def _marks(count: int, first: int = 0) -> np.ndarray:
    return _FIRST_MARK + first + np.arange(count)


def _place(kind: str, first: int = 0) -> Any:
    return _message(f"geometry_msgs/msg/{kind}", *_marks(3, first))


def _topic(name: str, message: Any) -> Topic:
    """The topic of messages like this one, whose times and numbers are marks."""
    template, spans = _encoded(message), []
    count = 0
    while (mark := struct.pack("<d", _FIRST_MARK + count)) in template:
        start = template.index(mark)
        if spans and start == spans[-1][0] + 8 * spans[-1][1]:
            spans[-1] = spans[-1][0], spans[-1][1] + 1
        else:
            spans.append((start, 1))
        count += 1
    stamp = struct.pack("<II", _STAMP_MARK, _STAMP_MARK)
    stamps = tuple(found.start() for found in re.finditer(re.escape(stamp), template))
    schema = message.__msgtype__
    return Topic(name, schema, _definition(schema), template, stamps, tuple(spans))
