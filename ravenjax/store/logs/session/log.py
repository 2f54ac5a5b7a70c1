"""Writes and reads session.mcap, the recording of a training session.

The profile is ros2 with CDR. The file has these topics for each arm (arm1 is gold, arm2 green),
with `STANDARD_HZ` messages a second.

    /armN/measured_js, setpoint_js,    sensor_msgs/JointState
        true_js, model_js              joints measured, desired, true, of the nominal model
    /armN/measured_cp, true_cp,        geometry_msgs/PoseStamped
        model_cp                       pose of the tip at measured, true or model joints
    /armN/haptic_cf                    geometry_msgs/WrenchStamped: force of the cue
    /tf                                tf2_msgs/TFMessage: frames as in a trace (`trace_log`).

Every millisecond there is a flat message on /ravenjax/signals, with every signal of the session as
float32. Events are on /ravenjax/events (std_msgs/String, one JSON object each), and as text on
/ravenjax/log (rcl_interfaces/Log). The time of a message is the start of the session plus one
millisecond per row. Its sequence number is the number of the row, so lost rows leave a gap.

A truncated file is readable. A block of rows is one chunk, which is passed to the operating system
at once. If the process is killed, only the current block is lost. A power failure may lose more.
"""

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from ravenjax import resources
from ravenjax.errors import StoreError
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.geometry.arrays import jaw_rotation
from ravenjax.store.files import disk_errors
from ravenjax.store.logs import mcap_records, topics
from ravenjax.store.logs.topics import ARM_TOPICS, EVENTS, METADATA, SIGNALS, Base, Topic

FILE = "session.mcap"
TICK_NS = 1_000_000
STANDARD_HZ = 100
_EVERY = 1000 // STANDARD_HZ
_BLOCK_ROWS = 4096

_CHANNELS = resources.read_tables(__file__, "log.toml")
_EVENT_KINDS = resources.read_tables(__file__, "events.toml")
"""Sentence of each kind of event of `ravenjax.train.protocol`, and severity if it is not "info"."""


class SessionWriter:
    """Writes the recording of a session while the session runs."""

    def __init__(self, path: Path, names: Sequence[str], header: Mapping[str, Any]):
        """names: names of a row's numbers, such as `gold/jpos/0`; header: content of session.json.

        Raise StoreError if the file cannot be created.
        """
        self.path = path
        with disk_errors(f"{path}: the recording cannot be written"):
            self._file = open(path, "wb")  # noqa: SIM115  closed by close()
        self._start_ns = _start_ns(header)
        # The columns of each signal: `gold/jpos` has those of gold/jpos/0, gold/jpos/1, ...
        self._columns: dict[str, list[int]] = {}
        for column, name in enumerate(names):
            signal, _, _ = name.rpartition("/")
            self._columns.setdefault(signal, []).append(column)
        self._bases = {
            arm: Base(tuple(base["origin"]), tuple(base["quaternion"]))
            for arm, base in (header.get("bases") or {}).items()
        }
        # This call also runs slow imports before the recording begins.
        standard = [topic for topic, _ in self._standard(np.zeros((1, len(names))))]
        self._flat = topics.signals_topic([topics.field_name(name) for name in names], single=True)
        self._metadata = {"header": json.dumps(header), "channels": json.dumps(list(names))}
        self._log = topics.LogWriter(self._file, [self._flat, *standard], self._metadata)
        self._file.flush()

    def add(self, first: int, rows: np.ndarray, events: Sequence[Mapping[str, Any]] = ()) -> None:
        """Write rows float32 [n, names], one per ms, and events that occurred in these rows.

        first: number of the first row. All is passed to the operating system at once. Events have
        the time of the last row. Raise StoreError if writing fails.
        """
        end = first + len(rows)
        numbers = np.arange(first, end)
        stamps = self._start_ns + numbers * TICK_NS
        self._log.add(self._flat, stamps, numbers, rows)
        due = numbers % _EVERY == 0
        if due.any():
            for topic, values in self._standard(rows[due]):
                self._log.add(topic, stamps[due], numbers[due], values)
        stamp = self._start_ns + max(0, end - 1) * TICK_NS
        for event in events:
            self._log.add_event(event, event_text(event), event_level(event), stamp)
        recorded = f"; the first {max(0, first)} ms of the session are recorded"
        with disk_errors(f"{self.path}: cannot be written", recorded):
            self._log.flush()

    def close(self) -> None:
        """Write the index, which readers of other programs need, and close the file.

        The names of signals, which readers of rows need, are at both ends: one end may be damaged.
        """
        self._log.finish(self._metadata)
        self._file.close()

    def _standard(self, rows: np.ndarray) -> Iterator[tuple[Topic, np.ndarray]]:
        # Yields (topic, numbers) of the standard topics of CRTK and ROS at these rows.
        series = {}
        for arm in ARM_TOPICS:
            of_arm = {
                name.removeprefix(f"{arm}/"): rows[:, columns]
                for name, columns in self._columns.items()
                if name.startswith(f"{arm}/")
            }
            states = [name for name in _CHANNELS["states"] if name in of_arm]
            series |= {f"{arm}/{name}": of_arm[name] for name in states}
            # An entry is `tip = ["tip", "tip_rotation", "link_jpos"]`: the signal of a position,
            # the series to make of it and of the rotation, and the joints that give the rotation.
            for name, (position, rotation, joints) in _CHANNELS["tips"].items():
                if name in of_arm and joints in of_arm:
                    series[f"{arm}/{position}"] = of_arm[name]
                    series[f"{arm}/{rotation}"] = jaw_rotation(arm, of_arm[joints])
            if "force" in of_arm:
                series[f"{arm}/haptic_force"] = of_arm["force"]
        return topics.standard_topics(ROBOT, series, self._bases)


@dataclass(frozen=True, eq=False)
class SessionLog:
    """The content of a session's recording."""

    header: dict[str, Any]  # session.json at the beginning of the session
    names: list[str]  # names of a row's numbers
    numbers: np.ndarray  # int64 [T], number of each row, with gaps where rows were lost
    rows: np.ndarray  # float32 [T, numbers that were read]
    events: list[dict[str, Any]]
    complete: bool  # True if the file was closed normally and is not truncated
    lost_bytes: int  # number of damaged bytes, and of bytes in an incomplete chunk at the end


def read_session_log(path: Path, keeps: Callable[[str], bool] = lambda name: True) -> SessionLog:
    """Read the recording of a session, as far as it is complete. keeps: returns whether to read the
    number of this name. Raise StoreError for another file.
    """
    content = mcap_records.scan_records(path)
    metadata = next((one.metadata for one in content.metadata if one.name == METADATA), {})
    if "channels" not in metadata:
        raise StoreError(
            f"{path}: is no recording of a session, because it has no list of signals; expected"
            f" {FILE} in the folder of a session"
        )
    names, header = json.loads(metadata["channels"]), json.loads(metadata["header"])
    columns = [column for column, name in enumerate(names) if keeps(name)]
    # The numbers, float32, are the last bytes of a message.
    width = 4 * len(names)

    def kept(block: bytearray) -> np.ndarray:
        return np.frombuffer(block, "<f4").reshape(-1, len(names))[:, columns]

    data, blocks = bytearray(), [np.zeros((0, len(columns)), np.float32)]
    numbers, events = [], []
    for message in content.messages((SIGNALS, EVENTS)):
        channel = content.channels.get(message.channel_id)
        if channel is not None and channel.topic == SIGNALS:
            numbers.append(message.sequence)
            data += message.data[-width:]
            if len(data) == _BLOCK_ROWS * width:
                blocks.append(kept(data))
                data = bytearray()
        elif channel is not None and channel.topic == EVENTS:
            events.append(json.loads(topics.ros2_types().decode(message.data, topics.TEXT).data))
    blocks.append(kept(data))
    row_numbers, rows = np.array(numbers, np.int64), np.concatenate(blocks)
    complete, lost_bytes = content.complete, content.lost_bytes
    return SessionLog(header, names, row_numbers, rows, events, complete, lost_bytes)


def _start_ns(header: Mapping[str, Any]) -> int:
    started = header.get("started")
    return round(datetime.fromisoformat(started).timestamp() * 1e3) * 1_000_000 if started else 0


@cache
def _sentence(kind: str) -> jinja2.Template:
    return jinja2.Template(_EVENT_KINDS[kind]["text"], undefined=jinja2.StrictUndefined)


def event_text(event: Mapping[str, Any]) -> str:
    """Return a sentence about an event, or its keys and values if it is unknown or incomplete."""
    try:
        return _sentence(event["kind"]).render(event, robot=ROBOT)
    except (KeyError, TypeError, ValueError, jinja2.UndefinedError):
        words = ", ".join(
            f"{name} {value}" for name, value in event.items() if name not in ("kind", "tick")
        )
        return f"{event['kind']}: {words}" if words else str(event["kind"])


def event_level(event: Mapping[str, Any]) -> str:
    """Return the severity of an event, one of `topics.LEVELS`."""
    return _EVENT_KINDS.get(event["kind"], {}).get("level", "info")
