"""A training session's recording, session.mcap: written while it happens, read back even where it was cut short.

Profile ros2, CDR, for each arm (arm1 is gold, arm2 green) `STANDARD_HZ` times a second

    /armN/measured_js, setpoint_js, model_js   sensor_msgs/JointState     joints measured, wanted, of the nominal model
    /armN/measured_cp, model_cp                geometry_msgs/PoseStamped  the tip, no rotation (all zero)
    /armN/haptic_cf                            geometry_msgs/WrenchStamped  force of the cue

every millisecond /ravenjax/signals, a flat message with every channel of the session as float32, exactly as it was;
and /ravenjax/events, std_msgs/String, one JSON object each. A message's time is the session's start plus a millisecond
a row, its sequence number the number of the row, so that rows which were lost leave a gap instead of shifting the rest.

A block of rows is one chunk that is handed to the operating system at once: a killed recorder loses what it had not
yet written, never what it had. What a power cut loses is the operating system's affair.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from mcap.writer import Writer as McapWriter

from ravenjax.store import cdr, mcap_records, topics
from ravenjax.store.files import StoreError
from ravenjax.store.topics import ARM_TOPICS, SIGNALS, Topic

FILE = "session.mcap"
EVENTS = "/ravenjax/events"
METADATA = "ravenjax"
TICK_NS = 1_000_000
STANDARD_HZ = 100
_EVERY = 1000 // STANDARD_HZ

_STATES = {"measured_js": "jpos", "setpoint_js": "jpos_d", "model_js": "model_jpos"}
_POSES = {"measured_cp": "position", "model_cp": "model_tip"}


class Writer:
    """The recording in progress."""

    def __init__(self, path: Path, names: Sequence[str], header: Mapping[str, Any]) -> None:
        """names: of a row's numbers, `gold/jpos/0` and so on; header: what session.json says.

        Raises StoreError where the file cannot be made.
        """
        self.path = path
        try:
            self._file = open(path, "wb")  # noqa: SIM115  closed by close()
        except OSError as error:
            raise StoreError(f"{path}: the recording cannot be written ({error.strerror or error})") from error
        self._start_ns = _start_ns(header)
        self._standard = _standard(names)
        self._flat = topics.signals([topics.field(name) for name in names], single=True)
        self._writer = McapWriter(self._file)
        self._writer.start(profile="ros2", library="ravenjax")
        self._writer.add_metadata(METADATA, {"header": json.dumps(header), "channels": json.dumps(list(names))})
        found = topics.register(
            self._writer, [self._flat, topics.text(EVENTS), *(topic for topic, _ in self._standard)]
        )
        self._signals, self._events, self._channels = found[0], found[1], found[2:]
        self._next = 0
        self._file.flush()

    def add(self, first: int, rows: np.ndarray, events: Sequence[Mapping[str, Any]] = ()) -> None:
        """Write rows float32 [n, names], the first of them number `first`, and the events that came with them.

        They are with the operating system when it returns. Raises StoreError where the disk refuses.
        """
        self._next = first + len(rows)
        numbers = np.arange(first, self._next)
        self._put(self._signals, self._flat, numbers, rows)
        chosen = numbers % _EVERY == 0
        if chosen.any():
            some = rows[chosen]
            for channel, (topic, places) in zip(self._channels, self._standard, strict=True):
                values = np.zeros((len(some), len(places)))
                there = places >= 0
                values[:, there] = some[:, places[there]]
                self._put(channel, topic, numbers[chosen], values)
        stamp = self._stamp(max(0, self._next - 1))
        for event in events:
            self._writer.add_message(self._events, stamp, cdr.string(json.dumps(event)), stamp)
        try:
            self._writer.flush()
        except OSError as error:
            raise StoreError(
                f"{self.path}: cannot be written ({error.strerror or error}); "
                f"the first {max(0, first)} ms of the session are recorded"
            ) from error

    def close(self) -> None:
        """Write the index; the seeking readers of other tools open the file from then on."""
        self._writer.finish()
        self._file.close()

    def _put(self, channel: int, topic: Topic, numbers: np.ndarray, values: np.ndarray) -> None:
        stamps = self._start_ns + numbers * TICK_NS
        add = self._writer.add_message
        for number, stamp, data in zip(
            numbers.tolist(), stamps.tolist(), topic.layout.encode(stamps, values), strict=True
        ):
            add(channel, stamp, data, stamp, number)

    def _stamp(self, number: int) -> int:
        return self._start_ns + number * TICK_NS


@dataclass(frozen=True, eq=False)
class SessionLog:
    """A recording read back."""

    header: dict[str, Any]  # as session.json had it when the session began
    names: list[str]  # of a row's numbers
    numbers: np.ndarray  # int64 [T], number of each row: gaps where rows were lost
    rows: np.ndarray  # float32 [T, names]
    events: list[dict[str, Any]]
    complete: bool  # closed by its recorder, not cut short
    lost_bytes: int  # at the end, of a chunk that was not finished; or damaged


def read(path: Path) -> SessionLog:
    """The recording of a session, as much as is there. Raises StoreError where it is no recording of a session."""
    found = mcap_records.scan(path)
    metadata = next((one.metadata for one in found.metadata if one.name == METADATA), {})
    if "channels" not in metadata:
        raise StoreError(
            f"{path}: is no recording of a session, it names no channels; expected the {FILE} of a session's folder"
        )
    names, header = json.loads(metadata["channels"]), json.loads(metadata["header"])
    kinds = {channel.id: channel.topic for channel in found.channels}
    width = 4 * len(names)
    numbers: list[int] = []
    data: list[bytes] = []
    events: list[dict[str, Any]] = []
    for channel, number, _, _, message in found.messages():
        topic = kinds.get(channel)
        if topic == SIGNALS:
            numbers.append(number)
            data.append(message[-width:])
        elif topic == EVENTS:
            events.append(json.loads(cdr.read_string(message)))
    rows = np.frombuffer(b"".join(data), "<f4").reshape(-1, len(names))
    return SessionLog(header, names, np.array(numbers, np.int64), rows, events, found.complete, found.lost_bytes)


def _standard(names: Sequence[str]) -> list[tuple[Topic, np.ndarray]]:
    """The standard topics that the channels allow, and which channel fills each number of theirs (-1: zero)."""
    place = {name: i for i, name in enumerate(names)}
    out: list[tuple[Topic, np.ndarray]] = []

    def find(arm: str, channel: str, width: int, more: int, topic: Topic) -> None:
        found = [place.get(f"{arm}/{channel}/{i}", -1) for i in range(width)]
        if min(found) >= 0:
            out.append((topic, np.array(found + [-1] * more)))

    for arm in ARM_TOPICS:
        for name, channel in _STATES.items():
            find(arm, channel, 7, 0, topics.joint_state(arm, name))
        for name, channel in _POSES.items():
            find(arm, channel, 3, 4, topics.pose(arm, name))
        find(arm, "force", 3, 3, topics.wrench(arm, "haptic_cf"))
    return out


def _start_ns(header: Mapping[str, Any]) -> int:
    """ns since 1970 at which the session began; 0 where the header does not say."""
    started = header.get("started")
    return round(datetime.fromisoformat(started).timestamp() * 1e3) * 1_000_000 if started else 0
