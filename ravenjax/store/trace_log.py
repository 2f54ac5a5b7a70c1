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

from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np
from mcap.writer import Writer
from scipy.spatial.transform import Rotation

from ravenjax.store import topics
from ravenjax.store.files import StoreError, write_aside
from ravenjax.store.schema import JOINTS
from ravenjax.store.topics import ARM_TOPICS, Topic

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


def write(path: Path, series: Mapping[str, np.ndarray], metadata: Mapping[str, str] | None = None) -> None:
    """Write the time series of one run, one message per topic and millisecond, first tick at time 0.

    `metadata` (run id, config hash, ...) becomes the file's metadata record "ravenjax". Raises StoreError where the
    series do not have the same number of ticks or the disk refuses.
    """
    arrays = {name: np.asarray(values) for name, values in series.items()}
    ticks = _ticks(path, arrays)
    time_ns = np.arange(ticks, dtype=np.int64) * TICK_NS
    filled = [*_arm_topics(arrays), *_signals(arrays)]
    messages = [topic.layout.encode(time_ns, values) for topic, values in filled]

    def fill(target: Path) -> None:
        with open(target, "wb") as file:
            writer = Writer(file, chunk_size=CHUNK_BYTES)
            writer.start(profile="ros2", library="ravenjax")
            writer.add_metadata("ravenjax", dict(metadata or {}))
            channels = topics.register(writer, [topic for topic, _ in filled])
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


def _arm_topics(arrays: Mapping[str, np.ndarray]) -> Iterator[tuple[Topic, np.ndarray]]:
    for arm in ARM_TOPICS:
        get = {
            name.removeprefix(f"{arm}/"): values for name, values in arrays.items() if name.startswith(f"{arm}/")
        }.get
        for name, (position, *others) in _JOINT_STATES.items():
            if (jpos := get(position)) is not None:
                found = [get(other) if other else None for other in others]
                there = [values is not None for values in found]
                values = [jpos, *(values for values in found if values is not None)]
                yield topics.joint_state(arm, name, True, *there), np.concatenate(values, axis=1)
        for name, (place, turn) in _POSES.items():
            if (points := get(place)) is not None:
                yield topics.pose(arm, name), np.concatenate([points, _quaternions(len(points), get(turn))], axis=1)
        if (force := get(_FORCE)) is not None:
            yield topics.wrench(arm, "haptic_cf"), np.concatenate([force, np.zeros_like(force)], axis=1)


def _quaternions(ticks: int, rotation: np.ndarray | None) -> np.ndarray:
    """[T, 4]; all zero is not a rotation, so viewers and readers can tell that there is none."""
    if rotation is None:
        return np.zeros((ticks, 4))
    return Rotation.from_matrix(rotation.astype(float).reshape(ticks, 3, 3)).as_quat()


def _signals(arrays: Mapping[str, np.ndarray]) -> Iterator[tuple[Topic, np.ndarray]]:
    names, found = [], []
    for name, values in arrays.items():
        if name.partition("/")[0] in ARM_TOPICS and name.partition("/")[2] in _TOPIC_SERIES:
            continue
        flat = values.reshape(len(values), -1)
        names += _scalar_names(name, flat.shape[1])
        found.append(flat)
    if found:
        yield topics.signals(names), np.concatenate(found, axis=1, dtype=float)


def _scalar_names(name: str, width: int) -> list[str]:
    base = topics.field(name)
    if width == 1:
        return [base]
    return [f"{base}_{JOINTS[i] if width == len(JOINTS) else i}" for i in range(width)]
