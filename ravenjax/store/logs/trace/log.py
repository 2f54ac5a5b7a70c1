"""One run's full time series as an MCAP file: profile ros2, CRTK topic names, standard messages.

Opens in Foxglove, Lichtblick, PlotJuggler, rerun and `ros2 bag`. Gold is arm1, green arm2, as in
the CRTK interface of raven2. Poses are in frame 0 of their arm, `armN_base`; /tf carries the frames

    world -> armN_base -> armN_tip_measured, armN_tip_true, armN_tip_model

Series are those of `time_series`, each optional: of each arm

    /armN/measured_js, setpoint_js, true_js, model_js    sensor_msgs/JointState
    /armN/measured_cp, setpoint_cp, true_cp, model_cp    geometry_msgs/PoseStamped
    /armN/golden_tip                                     geometry_msgs/PointStamped: its orientation is not kept
    /armN/haptic_cf                                      geometry_msgs/WrenchStamped, device units

A tip whose rotation is not among the series is a point, `/armN/model_tip`, instead of a pose. What
happened is on /ravenjax/events (std_msgs/String, one JSON object each) and in words on
/ravenjax/log (rcl_interfaces/Log). Every series without a topic of its own, [T] or [T, k], becomes
one or k named float64 of the flat message on /ravenjax/signals; so do the true tip and the golden
run's.
"""  # noqa: E501

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.writer import Writer

from ravenjax import robots
from ravenjax.store.files import write_aside
from ravenjax.store.logs import time_series, topics
from ravenjax.store.logs.topics import Topic, quaternions
from ravenjax.vocabulary.robot import Robot

CHUNK_BYTES = (
    64 * 1024
)  # a kill loses at most one chunk, a few ticks; the library's default of 1 MiB nearly a second
TICK_NS = 1_000_000  # ns, one control tick
METADATA = "ravenjax"

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
_TOPIC_SERIES = {name for names in (*_JOINT_STATES.values(), *_TIPS.values()) for name in names} | {
    _FORCE
}
_ALSO_SIGNALS = {"tip", "golden_tip"}


class Base(NamedTuple):
    """Where an arm stands: its frame 0 in the world."""

    origin: tuple[float, float, float]  # m
    quaternion: tuple[float, float, float, float]  # x, y, z, w


def write(
    path: Path,
    series: Mapping[str, np.ndarray],
    metadata: Mapping[str, str] | None = None,
    *,
    bases: Mapping[str, Base] | None = None,
    events: Sequence[Mapping[str, Any]] = (),
    robot: Robot = robots.USUAL,
) -> None:
    """Write the time series of one run, one message per topic and millisecond, first tick at time
    0.

    `metadata` (run id, fault, ...) becomes the file's metadata record "ravenjax". bases: of each
    arm; without one its base is the root of its frames. events: each has "tick" (ms), "kind",
    "text" and "level" of topics.LEVELS. Raises StoreError where the series do not have the same
    number of ticks or the disk refuses.
    """
    arrays = {name: np.asarray(values) for name, values in series.items()}
    ticks = time_series.check(arrays, str(path))
    time_ns = np.arange(ticks, dtype=np.int64) * TICK_NS
    filled = [
        *_arm_topics(robot, arrays),
        *_frames(robot, arrays, bases or {}),
        *_signals(robot, arrays),
    ]
    messages = [topic.encode(time_ns, values) for topic, values in filled]

    def fill(target: Path) -> None:
        with open(target, "wb") as file:
            writer = Writer(file, chunk_size=CHUNK_BYTES)
            writer.start(profile="ros2", library="ravenjax")
            writer.add_metadata(METADATA, dict(metadata or {}))
            channels = topics.register(writer, [topic for topic, _ in filled])
            tell = _EventWriter(writer, events)
            for tick, stamp in enumerate(time_ns.tolist()):
                for channel, encoded in zip(channels, messages, strict=True):
                    if tick in encoded:
                        writer.add_message(channel, stamp, encoded[tick], stamp, tick)
                tell.until(tick)
            writer.finish()

    write_aside(path, fill)


class _EventWriter:
    """Writes the events between the ticks, in their order."""

    def __init__(self, writer: Writer, events: Sequence[Mapping[str, Any]]) -> None:
        self._writer = writer
        self._left = sorted(events, key=lambda event: event["tick"])[::-1]
        self._channels = topics.register(writer, topics.events()) if events else []

    def until(self, tick: int) -> None:
        while self._left and self._left[-1]["tick"] <= tick:
            event = self._left.pop()
            stamp = max(0, int(event["tick"])) * TICK_NS
            encoded = topics.encoded_event(event, event["text"], event["level"], stamp)
            for channel, data in zip(self._channels, encoded, strict=True):
                self._writer.add_message(channel, stamp, data, stamp, tick)


def _of_arm(arrays: Mapping[str, np.ndarray], arm: str) -> dict[str, np.ndarray]:
    return {
        name.removeprefix(f"{arm}/"): values
        for name, values in arrays.items()
        if name.startswith(f"{arm}/")
    }


def _arm_topics(
    robot: Robot, arrays: Mapping[str, np.ndarray]
) -> Iterator[tuple[Topic, np.ndarray]]:
    for arm in robot.arms:
        own = _of_arm(arrays, arm)
        for name, series in _JOINT_STATES.items():
            if series[0] in own:
                present = [one is not None and one in own for one in series]
                values = [
                    own[one]
                    for one, there in zip(series, present, strict=True)
                    if there and one is not None
                ]
                yield (
                    topics.joint_state(arm, name, robot.joints, *present),
                    np.concatenate(values, axis=1),
                )
        for name, (place, _) in _TIPS.items():
            if place in own:
                pose = _pose(own, name)
                topic = (
                    topics.point(arm, f"{name}_tip")
                    if pose is None
                    else topics.pose(arm, f"{name}_cp")
                )
                yield topic, own[place].astype(float) if pose is None else pose
        if _FORCE in own:
            yield (
                topics.wrench(arm, "haptic_cf"),
                np.concatenate([own[_FORCE], np.zeros_like(own[_FORCE])], axis=1),
            )


def _pose(own: Mapping[str, np.ndarray], name: str) -> np.ndarray | None:
    """x, y, z and quaternion [T, 7] of a tip; None where its rotation is not known."""
    place, rotation = _TIPS[name]
    if place not in own or rotation not in own:
        return None
    return np.concatenate(
        [own[place], quaternions(own[rotation].reshape(-1, 3, 3))], axis=1, dtype=float
    )


def _frames(
    robot: Robot, arrays: Mapping[str, np.ndarray], bases: Mapping[str, Base]
) -> Iterator[tuple[Topic, np.ndarray]]:
    pairs: list[tuple[str, str]] = []
    values: list[np.ndarray] = []
    for arm in robot.arms:
        own = _of_arm(arrays, arm)
        tips = {name: pose for name in _FRAMES if (pose := _pose(own, name)) is not None}
        if tips and arm in bases:
            pairs.append((topics.WORLD, topics.base(arm)))
            row = np.array([*bases[arm].origin, *bases[arm].quaternion])
            values.append(np.broadcast_to(row, (len(next(iter(tips.values()))), 7)))
        pairs += [(topics.base(arm), topics.tip(arm, name)) for name in tips]
        values += tips.values()
    if pairs:
        yield topics.frames(pairs), np.concatenate(values, axis=1)


def _signals(robot: Robot, arrays: Mapping[str, np.ndarray]) -> Iterator[tuple[Topic, np.ndarray]]:
    names: list[str] = []
    columns: list[np.ndarray] = []
    for name, values in arrays.items():
        arm, _, own = name.rpartition("/")
        if arm in robot.arms and own in _TOPIC_SERIES - _ALSO_SIGNALS:
            continue
        flat = values.reshape(len(values), -1)
        names += _scalar_names(robot, name, flat.shape[1])
        columns.append(flat)
    if columns:
        yield topics.signals(names), np.concatenate(columns, axis=1, dtype=float)


def _scalar_names(robot: Robot, name: str, width: int) -> list[str]:
    base = topics.field(name)
    if width == 1:
        return [base]
    return [f"{base}_{robot.joints[i] if width == len(robot.joints) else i}" for i in range(width)]
