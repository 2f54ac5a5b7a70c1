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
from typing import Any

import numpy as np
from mcap.writer import Writer

from ravenjax import robots
from ravenjax.store.files import write_aside
from ravenjax.store.logs import time_series, topics
from ravenjax.store.logs.topics import Base, Topic
from ravenjax.vocabulary.robot import Robot

CHUNK_BYTES = (
    64 * 1024
)  # a kill loses at most one chunk, a few ticks; the library's default of 1 MiB nearly a second
TICK_NS = 1_000_000  # ns, one control tick
METADATA = "ravenjax"
_ALSO_SIGNALS = {"tip", "golden_tip"}


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
    filled = [*topics.standard(robot, arrays, bases or {}), *_signals(robot, arrays)]
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


def _signals(robot: Robot, arrays: Mapping[str, np.ndarray]) -> Iterator[tuple[Topic, np.ndarray]]:
    names: list[str] = []
    columns: list[np.ndarray] = []
    for name, values in arrays.items():
        arm, _, own = name.rpartition("/")
        if arm in robot.arms and own in topics.SERIES - _ALSO_SIGNALS:
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
