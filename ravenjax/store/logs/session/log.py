"""A training session's recording, session.mcap: written while it happens, read back even where it
was cut short.

Profile ros2, CDR, for each arm (arm1 is gold, arm2 green) `STANDARD_HZ` times a second

    /armN/measured_js, setpoint_js, true_js, model_js  sensor_msgs/JointState     joints measured, wanted, true, of the
                                                                                  nominal model
    /armN/measured_cp, true_cp, model_cp       geometry_msgs/PoseStamped   the tip, with the orientation at those joints
    /armN/haptic_cf                            geometry_msgs/WrenchStamped  force of the cue
    /tf                                        tf2_msgs/TFMessage          frames as in a trace (`trace.log`)

every millisecond /ravenjax/signals, a flat message with every channel of the session as float32,
exactly as it was; /ravenjax/events, std_msgs/String, one JSON object each, and the same in words on
/ravenjax/log, rcl_interfaces/Log. A message's time is the session's start plus a millisecond a row,
its sequence number the number of the row, so that rows which were lost leave a gap instead of
shifting the rest.

A block of rows is one chunk that is handed to the operating system at once: a killed recorder loses
what it had not yet written, never what it had. What a power cut loses is the operating system's
affair.
"""  # noqa: E501

from __future__ import annotations

import json
import struct
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.writer import Writer as McapWriter

from ravenjax.errors import StoreError
from ravenjax.robots.raven2 import ROBOT
from ravenjax.robots.raven2.geometry.arrays import jaw_rotation
from ravenjax.store.logs import mcap_records, topics
from ravenjax.store.logs.topics import ARM_TOPICS, EVENTS, SIGNALS, Base, Topic

FILE = "session.mcap"
METADATA = "ravenjax"
TICK_NS = 1_000_000
STANDARD_HZ = 100
_EVERY = 1000 // STANDARD_HZ

_STATES = ("jpos", "jpos_d", "link_jpos", "model_jpos")
_TIPS = {
    "position": ("position", "rotation", "jpos"),
    "tip": ("tip", "tip_rotation", "link_jpos"),
    "model_tip": ("model_position", "model_rotation", "model_jpos"),
}
"""Of a channel: the series of its place and of its orientation as `topics.standard` names them, and
the joints at which the orientation is taken."""
_PLAIN = ("scenario", "seed", "robot", "engine", "code_hash", "started")
"""What of the header is in the metadata under its own name, too."""


class SessionWriter:
    """The recording in progress."""

    def __init__(self, path: Path, names: Sequence[str], header: Mapping[str, Any]) -> None:
        """names: of a row's numbers, `gold/jpos/0` and so on; header: what session.json says.

        Raises StoreError where the file cannot be made.
        """
        self.path = path
        try:
            self._file = open(path, "wb")  # noqa: SIM115  closed by close()
        except OSError as error:
            raise StoreError(
                f"{path}: the recording cannot be written ({error.strerror or error})"
            ) from error
        self._start_ns = _start_ns(header)
        self._places: dict[str, list[int]] = {}
        for place, name in enumerate(names):
            self._places.setdefault(name.rpartition("/")[0], []).append(place)
        self._bases = {
            arm: Base(tuple(one["origin"]), tuple(one["quaternion"]))
            for arm, one in (header.get("bases") or {}).items()
        }
        # Imports what it needs, too: a recording that began must not wait for it.
        standard = [topic for topic, _ in self._standard(np.zeros((1, len(names))))]
        self._flat = topics.signals([topics.field(name) for name in names], single=True)
        self._writer = McapWriter(self._file)
        _spill_index(self._writer)
        self._writer.start(profile="ros2", library="ravenjax")
        self._metadata = _metadata(names, header)
        self._writer.add_metadata(METADATA, self._metadata)
        self._signals, *channels = topics.register(
            self._writer, [self._flat, *topics.events(), *standard]
        )
        self._events, self._channels = channels[:2], channels[2:]
        self._next = 0
        self._file.flush()

    def add(self, first: int, rows: np.ndarray, events: Sequence[Mapping[str, Any]] = ()) -> None:
        """Write rows float32 [n, names], the first of them number `first`, and the events that came
        with them.

        They are with the operating system when it returns. Raises StoreError where the disk
        refuses.
        """
        self._next = first + len(rows)
        numbers = np.arange(first, self._next)
        self._put(self._signals, self._flat, numbers, rows)
        due = numbers % _EVERY == 0
        if due.any():
            filled = zip(self._channels, self._standard(rows[due]), strict=True)
            for channel, (topic, values) in filled:
                self._put(channel, topic, numbers[due], values)
        stamp = self._stamp(max(0, self._next - 1))
        for event in events:
            encoded = topics.encoded_event(event, event_text(event), event_level(event), stamp)
            for channel, data in zip(self._events, encoded, strict=True):
                self._writer.add_message(channel, stamp, data, stamp)
        try:
            self._writer.flush()
        except OSError as error:
            raise StoreError(
                f"{self.path}: cannot be written ({error.strerror or error}); "
                f"the first {max(0, first)} ms of the session are recorded"
            ) from error

    def close(self) -> None:
        """Write the index; the seeking readers of other tools open the file from then on. What the
        session was stands at both ends of the file, since without it no row can be read."""
        self._writer.add_metadata(METADATA, self._metadata)
        self._writer.finish()
        self._file.close()

    def _put(self, channel: int, topic: Topic, numbers: np.ndarray, values: np.ndarray) -> None:
        stamps = self._start_ns + numbers * TICK_NS
        add = self._writer.add_message
        for row, data in topic.encode(stamps, values).items():
            stamp = int(stamps[row])
            add(channel, stamp, data, stamp, int(numbers[row]))

    def _standard(self, rows: np.ndarray) -> Iterator[tuple[Topic, np.ndarray]]:
        """The standard topics that the channels allow, and what rows [n, names] fill them with."""
        series = {}
        for arm in ARM_TOPICS:
            own = {
                name.removeprefix(f"{arm}/"): rows[:, places]
                for name, places in self._places.items()
                if name.startswith(f"{arm}/")
            }
            series |= {f"{arm}/{name}": own[name] for name in _STATES if name in own}
            for name, (place, rotation, joints) in _TIPS.items():
                if name in own and joints in own:
                    series[f"{arm}/{place}"] = own[name]
                    series[f"{arm}/{rotation}"] = jaw_rotation(arm, own[joints])
            if "force" in own:
                series[f"{arm}/haptic_force"] = own["force"]
        return topics.standard(ROBOT, series, self._bases)

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
    """The recording of a session, as much as is there. Raises StoreError where it is no
    recording of a session.
    """
    content = mcap_records.scan(path)
    metadata = next((one.metadata for one in content.metadata if one.name == METADATA), {})
    if "channels" not in metadata:
        raise StoreError(
            f"{path}: is no recording of a session, it names no channels; expected the {FILE} of a"
            " session's folder"
        )
    names, header = json.loads(metadata["channels"]), json.loads(metadata["header"])
    width = 4 * len(names)
    numbers: list[int] = []
    data: list[bytes] = []
    events: list[dict[str, Any]] = []
    for message in content.messages():
        channel = content.channels.get(message.channel_id)
        if channel is not None and channel.topic == SIGNALS:
            numbers.append(message.sequence)
            data.append(message.data[-width:])
        elif channel is not None and channel.topic == EVENTS:
            events.append(topics.event_of(message.data))
    rows = np.frombuffer(b"".join(data), "<f4").reshape(-1, len(names))
    return SessionLog(
        header,
        names,
        np.array(numbers, np.int64),
        rows,
        events,
        content.complete,
        content.lost_bytes,
    )


def _metadata(names: Sequence[str], header: Mapping[str, Any]) -> dict[str, str]:
    """The header as JSON, the channels, and what tells sessions apart as plain text."""
    plain = {name: header[name] for name in _PLAIN if name in header}
    if isinstance(scenario := plain.get("scenario"), Mapping):
        plain["scenario"] = scenario.get("name", "")
    plain["session"] = header.get("name", "")
    plain["version"] = (header.get("versions") or {}).get("ravenjax", "")
    plain["hazards"] = json.dumps(
        [hazard.get("title", "") for hazard in header.get("hazards") or ()]
    )
    return {name: str(value) for name, value in plain.items()} | {
        "header": json.dumps(header),
        "channels": json.dumps(list(names)),
    }


def _start_ns(header: Mapping[str, Any]) -> int:
    """ns since 1970 at which the session began; 0 where the header does not say."""
    started = header.get("started")
    return round(datetime.fromisoformat(started).timestamp() * 1e3) * 1_000_000 if started else 0


# Events in words. Kinds: `ravenjax.train.protocol.messages`.

Event = Mapping[str, Any]

_TEXTS: dict[str, Callable[[Event], str]] = {
    "phase": lambda e: f"session: {e['phase']}",
    "view": lambda e: f"view: {e['view']}",
    "console": lambda e: "console answers" if e["alive"] else "console is silent",
    "pedal": lambda e: f"pedal {'down' if e['down'] else 'up'}",
    "runlevel": lambda e: f"run level: {ROBOT.run_level(e['runlevel'])}",
    "alarm": lambda e: f"check {e['check']} trips",
    "hazard_armed": lambda e: f"hazard {e['number']} is armed",
    "hazard_struck": lambda e: f"hazard {e['number']} strikes",
    "knowable": lambda e: f"hazard {e['number']} can be known from now on, by {e['by']}",
    "cue": lambda e: (
        f"haptic cue on the {e['arm']} arm" + (" without a hazard" if e["number"] < 0 else "")
    ),
    "stray": lambda e: f"true tip of the {e['arm']} arm {e['mm']:g} mm off",
    "response": lambda e: (
        f"operator responds: {e['what']}" + ("" if e["ok"] else ", not the right response")
    ),
    "hazard_over": lambda e: f"hazard {e['number']} is over: {e['outcome']}",
    "hazard_row": lambda _: "the row of that hazard in hazards.csv",
    "target": lambda e: f"next target: {e['target']}",
    "level": lambda e: (
        f"level {e['level']} of {e['of']}, {e['in_a_row']} of {e['needs']} rounds in a row"
    ),
    "task_done": lambda _: "task done",
    "note": lambda e: f"note: {e['text']}",
    "overrun": lambda e: f"{e['late_ticks']} late ticks",
    "trouble": lambda e: str(e["text"]),
    "lost_rows": lambda e: f"{e['rows']} rows were lost",
    "lost_events": lambda e: f"{e['events']} events were lost",
    "end": lambda e: f"session ends: {e['reason']}",
}
_LEVELS = {
    "alarm": "warn",
    "cue": "warn",
    "hazard_struck": "error",
    "lost_events": "warn",
    "lost_rows": "warn",
    "overrun": "warn",
    "stray": "error",
    "trouble": "warn",
}


def event_text(event: Event) -> str:
    """A sentence; of an event of another kind, or that lacks a word, its words as they are."""
    try:
        return _TEXTS[event["kind"]](event)
    except (KeyError, TypeError, ValueError):
        words = ", ".join(
            f"{name} {value}" for name, value in event.items() if name not in ("kind", "tick")
        )
        return f"{event['kind']}: {words}" if words else str(event["kind"])


def event_level(event: Event) -> str:
    """Severity, one of `topics.LEVELS`."""
    return _LEVELS.get(event["kind"], "info")


# The index of a recording while it is written, on disk.

_KEPT = "_Writer__chunk_indices"
"""Where MCAP's writer keeps a kilobyte of memory for each chunk: 300 MB an hour of a session."""


class _Record:
    """An entry as it stands in the file."""

    def __init__(self, content: bytes) -> None:
        self._content = content

    def write(self, stream: RecordBuilder) -> None:
        """Put it into the summary."""
        stream.write(self._content)


class _SpilledIndex:
    """What stands in for the writer's list of its chunks: entries go to an unnamed file, which
    ends with the writer.
    """

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115  as long as the recording

    def append(self, entry: Any) -> None:
        """One more chunk."""
        builder = RecordBuilder()
        entry.write(builder)
        content = builder.end()
        self._file.write(struct.pack("<I", len(content)) + content)

    def __iter__(self) -> Iterator[_Record]:
        """Every entry, in order."""
        self._file.seek(0)
        while head := self._file.read(4):
            yield _Record(self._file.read(struct.unpack("<I", head)[0]))


def _spill_index(writer: McapWriter) -> None:
    """Let `writer` keep its index on disk; where a later version of it keeps none under this
    name, nothing changes.
    """
    if getattr(writer, _KEPT, None) == []:
        setattr(writer, _KEPT, _SpilledIndex())
