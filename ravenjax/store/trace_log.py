"""One run's full time series as an MCAP file: profile ros2, CRTK topic names, standard messages.

Opens in Foxglove, Lichtblick, PlotJuggler, rerun and `ros2 bag`. Gold is arm1, green arm2, as in the CRTK interface of
raven2. Poses are in frame 0 of their arm.

Series read per arm, each [T, k] and each optional:

    <arm>/jpos, jvel, tau_d, jpos_d  [T,7]   rad and m, rad/s and m/s, Nm and N
    <arm>/position, position_d, model_position  [T,3]  m
    <arm>/rotation, rotation_d, model_rotation  [T,9] or [T,3,3]  row by row
    <arm>/haptic_force  [T,3]  device units

Every other series, [T] or [T, k], becomes one or k named float64 of the flat message on /ravenjax/signals.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.writer import Writer
from scipy.spatial.transform import Rotation

from ravenjax.store import ros_messages
from ravenjax.store.cdr import Layout
from ravenjax.store.files import StoreError, write_aside
from ravenjax.store.schema import JOINTS

ARM_TOPICS = {"gold": "arm1", "green": "arm2"}
CHUNK_BYTES = 64 * 1024  # a kill loses at most one chunk, a few ticks; the library's default of 1 MiB nearly a second
TICK_NS = 1_000_000  # ns, one control tick

_JOINT_STATES = {"measured_js": ("jpos", "jvel", None), "setpoint_js": ("jpos_d", None, "tau_d")}
_POSES = {
    "measured_cp": ("position", "rotation"),
    "setpoint_cp": ("position_d", "rotation_d"),
    "model_cp": ("model_position", "model_rotation"),
}
_FORCE = "haptic_force"
_TOPIC_SERIES = {"jpos", "jvel", "jpos_d", "tau_d", _FORCE} | {name for pair in _POSES.values() for name in pair}


@dataclass(frozen=True)
class _Topic:
    name: str
    schema: str
    definition: str  # ros2msg text of the schema
    layout: Layout
    values: np.ndarray  # [T, numbers of the layout]


def write(path: Path, series: Mapping[str, np.ndarray], metadata: Mapping[str, str] | None = None) -> None:
    """Write the time series of one run, one message per topic and millisecond, first tick at time 0.

    `metadata` (run id, config hash, ...) becomes the file's metadata record "ravenjax". Raises StoreError where the
    series do not have the same number of ticks or the disk refuses.
    """
    arrays = {name: np.asarray(values) for name, values in series.items()}
    ticks = _ticks(path, arrays)
    time_ns = np.arange(ticks, dtype=np.int64) * TICK_NS
    topics = [*_arm_topics(arrays), *_signals(arrays)]
    messages = [topic.layout.encode(time_ns, topic.values) for topic in topics]

    def fill(target: Path) -> None:
        with open(target, "wb") as file:
            writer = Writer(file, chunk_size=CHUNK_BYTES)
            writer.start(profile="ros2", library="ravenjax")
            writer.add_metadata("ravenjax", dict(metadata or {}))
            channels = _register(writer, topics)
            for tick, stamp in enumerate(time_ns.tolist()):
                for channel, encoded in zip(channels, messages, strict=True):
                    writer.add_message(channel, stamp, encoded[tick], stamp, tick)
            writer.finish()

    write_aside(path, fill)


def _ticks(path: Path, arrays: Mapping[str, np.ndarray]) -> int:
    lengths = {name: values.shape[0] if values.ndim else 0 for name, values in arrays.items()}
    counts = set(lengths.values())
    if len(counts) != 1 or 0 in counts:
        shown = ", ".join(f"{name} {length}" for name, length in list(lengths.items())[:6])
        raise StoreError(f"{path}: a trace needs series of one length, at least 1 tick each, got {shown or 'none'}")
    return counts.pop()


def _register(writer: Writer, topics: list[_Topic]) -> list[int]:
    schemas: dict[str, int] = {}
    for topic in topics:
        if topic.schema not in schemas:
            schemas[topic.schema] = writer.register_schema(topic.schema, "ros2msg", topic.definition.encode())
    return [writer.register_channel(topic.name, "cdr", schemas[topic.schema]) for topic in topics]


# --- topics -----------------------------------------------------------------------------------------------------------


def _arm_topics(arrays: Mapping[str, np.ndarray]) -> Iterator[_Topic]:
    for arm, topic in ARM_TOPICS.items():
        get = {
            name.removeprefix(f"{arm}/"): values for name, values in arrays.items() if name.startswith(f"{arm}/")
        }.get
        for name, (position, velocity, effort) in _JOINT_STATES.items():
            if (jpos := get(position)) is not None:
                yield _joint_state(f"/{topic}/{name}", f"{topic}_base", jpos, get(velocity), get(effort))
        for name, (place, turn) in _POSES.items():
            if (points := get(place)) is not None:
                yield _pose(f"/{topic}/{name}", f"{topic}_base", points, get(turn))
        if (force := get(_FORCE)) is not None:
            yield _wrench(f"/{topic}/haptic_cf", f"{topic}_base", force)


def _joint_state(
    name: str, frame: str, position: np.ndarray, velocity: np.ndarray | None, effort: np.ndarray | None
) -> _Topic:
    layout = Layout(frame)
    layout.texts(JOINTS)
    found = []
    for values in (position, velocity, effort):
        layout.sequence(0 if values is None else len(JOINTS))
        if values is not None:
            found.append(values)
    return _topic(name, "sensor_msgs/msg/JointState", layout, np.concatenate(found, axis=1))


def _pose(name: str, frame: str, position: np.ndarray, rotation: np.ndarray | None) -> _Topic:
    ticks = len(position)
    if rotation is None:  # all zero is not a rotation, so viewers and readers can tell that there is none
        turns = np.zeros((ticks, 4))
    else:
        turns = Rotation.from_matrix(rotation.astype(float).reshape(ticks, 3, 3)).as_quat()
    layout = Layout(frame)
    layout.numbers(7)
    return _topic(name, "geometry_msgs/msg/PoseStamped", layout, np.concatenate([position, turns], axis=1))


def _wrench(name: str, frame: str, force: np.ndarray) -> _Topic:
    layout = Layout(frame)
    layout.numbers(6)
    return _topic(
        name, "geometry_msgs/msg/WrenchStamped", layout, np.concatenate([force, np.zeros_like(force)], axis=1)
    )


def _topic(name: str, schema: str, layout: Layout, values: np.ndarray) -> _Topic:
    return _Topic(name, schema, ros_messages.DEFINITIONS[schema], layout, values)


def _signals(arrays: Mapping[str, np.ndarray]) -> Iterator[_Topic]:
    names, found = [], []
    for name, values in arrays.items():
        if name.partition("/")[0] in ARM_TOPICS and name.partition("/")[2] in _TOPIC_SERIES:
            continue
        flat = values.reshape(len(values), -1)
        names += _scalar_names(name, flat.shape[1])
        found.append(flat)
    if found:
        layout = Layout("")
        layout.numbers(len(names))
        yield _Topic(
            "/ravenjax/signals",
            ros_messages.SIGNALS,
            ros_messages.signals(names),
            layout,
            np.concatenate(found, axis=1, dtype=float),
        )


def _scalar_names(name: str, width: int) -> list[str]:
    """Field names as ROS 2 allows them: lower case letters, digits, single underscores."""
    base = re.sub(r"[^a-z0-9]+", "_", name.lower()).strip("_")
    if width == 1:
        return [base]
    return [f"{base}_{JOINTS[i] if width == len(JOINTS) else i}" for i in range(width)]
