"""Writes the time series of one run as an MCAP file with the topics and message types of ROS 2.

The file opens in Foxglove, Lichtblick, PlotJuggler, rerun and `ros2 bag`. Gold is arm1, green arm2,
as in raven2's CRTK. Poses are in frame 0 of their arm, `armN_frame0`. /tf has these frames:

    world -> armN_frame0 -> armN_tip_measured, armN_tip_true, armN_tip_model

These are the topics of each arm. A run without a series lacks the topic of this series.

    /armN/measured_js, setpoint_js, true_js, model_js    sensor_msgs/JointState
    /armN/measured_cp, setpoint_cp, true_cp, model_cp    geometry_msgs/PoseStamped
    /armN/golden_tip                                     geometry_msgs/PointStamped
                                                         (its orientation is not stored)
    /armN/haptic_cf                                      geometry_msgs/WrenchStamped, device units.

A tip without a series of its rotation has a point topic, such as `/armN/model_tip`, instead of a
pose topic. Events are on /ravenjax/events (std_msgs/String, one JSON object each), and as text on
/ravenjax/log (rcl_interfaces/Log). Every other series [T] or [T, k] becomes one or k named float64
fields of the flat message on /ravenjax/signals, as do the true tip and the golden run's tip.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ravenjax import robots
from ravenjax.store.files import write_aside
from ravenjax.store.logs import time_series, topics
from ravenjax.store.logs.time_series import Series
from ravenjax.store.logs.topics import Base, Topic
from ravenjax.vocabulary.robot import Robot

CHUNK_BYTES = 64 * 1024
"""Size of a chunk, a few ticks, in bytes. If the process is killed, at most one chunk is lost."""
TICK_NS = 1_000_000  # one control tick, ns
BLOCK = 64  # ticks that are written together
_ALSO_SIGNALS = {"tip", "golden_tip"}


def write_trace(
    path: Path,
    series: Series,
    metadata: Mapping[str, str] | None = None,
    *,
    bases: Mapping[str, Base] | None = None,
    events: Sequence[Mapping[str, Any]] = (),
    robot: Robot = robots.USUAL,
) -> None:
    """Write the time series of one run from time 0, one message per topic and millisecond.
    metadata: run id, fault and so on. bases: base of each arm; without a base, the frame 0 of an
    arm has no parent frame. events: dicts with "tick" (ms), "kind", "text" and "level", one of
    topics.LEVELS. Raise StoreError if the numbers of ticks differ or the file cannot be written.
    """
    arrays = {name: np.asarray(values) for name, values in series.items()}
    ticks = time_series.check_series(arrays, str(path))
    pairs = [*topics.standard_topics(robot, arrays, bases or {}), *_signals(robot, arrays)]
    events_of: dict[int, list[Mapping[str, Any]]] = {}
    for event in events:
        events_of.setdefault(max(0, int(event["tick"])), []).append(event)

    def fill(target: Path):
        # Writes all series in blocks of ticks, so that messages are almost in the order of time.
        with open(target, "wb") as file:
            log = topics.LogWriter(file, [topic for topic, _ in pairs], metadata or {}, CHUNK_BYTES)
            for first in range(0, ticks, BLOCK):
                numbers = np.arange(first, min(first + BLOCK, ticks))
                for topic, values in pairs:
                    log.add(topic, numbers * TICK_NS, numbers, values[numbers])
                for tick in numbers.tolist():
                    for event in events_of.get(tick, ()):
                        log.add_event(event, event["text"], event["level"], tick * TICK_NS, tick)
            log.finish()

    write_aside(path, fill)


def _signals(robot: Robot, arrays: Series) -> Iterator[tuple[Topic, np.ndarray]]:
    # Yields one topic with all series that have no standard topic, and with the tips. It has a
    # field for each number, such as gold_jpos_elbow. Without such series it yields nothing.
    names = []
    columns = []
    for name, values in arrays.items():
        arm, _, quantity = name.rpartition("/")
        if arm in robot.arms and quantity in topics.SERIES - _ALSO_SIGNALS:
            continue
        flat = values.reshape(len(values), -1)
        base, width = topics.field_name(name), flat.shape[1]
        labels = robot.joints if width == len(robot.joints) else range(width)
        names += [base] if width == 1 else [f"{base}_{label}" for label in labels]
        columns.append(flat)
    if columns:
        yield topics.signals_topic(names), np.concatenate(columns, axis=1, dtype=float)
