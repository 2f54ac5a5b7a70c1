"""Reads a recording in an MCAP file of CRTK topics. The package's docstring lists them."""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Message, Schema
from mcap.stream_reader import StreamReader

from ravenjax.errors import UserError, suggestion
from ravenjax.robots.raven2.arms import JOINTS
from ravenjax.store.logs import topics as names
from ravenjax.store.motion.table_file import unit
from ravenjax.store.motion.track import ArmTrack, Track

ARM_TOPICS = {arm: f"/{name}/" for arm, name in names.ARM_TOPICS.items()}
SOURCES = ("setpoint", "measured")
"""What a motion is taken from: the first of them that the file has."""

POSE, JOINT_STATE = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/JointState"


def read(path: Path, arms: tuple[str, ...], rate_hz: float | None) -> Track:
    """The recording of `arms` in an MCAP file. UserError names the topic and what is wrong with
    it.
    """
    messages, schemas = _messages(path)
    raw = {arm: _poses(path, messages, topic_of(path, schemas, ARM_TOPICS[arm])) for arm in arms}
    jaws = {arm: _jaws(path, messages, schemas, ARM_TOPICS[arm]) for arm in arms}
    return assembled(path, raw, jaws, rate_hz, list(schemas))


def assembled(
    path: Path,
    raw: dict[str, TopicValues],
    jaws_of: dict[str, TopicValues | None],
    rate_hz: float | None,
    every: list[str],
) -> Track:
    """The recording that tips and jaws of each arm make. every: topics of the file. UserError as
    of `read`.
    """
    by_header = all(_runs(one.header_ns) for one in raw.values())
    times = {arm: one.header_ns if by_header else one.log_ns for arm, one in raw.items()}
    begin = min(int(values[0]) for values in times.values())
    topics, tracks = [one.topic for one in raw.values()], {}
    for arm, one in raw.items():
        jaws, opening = jaws_of[arm], None
        if jaws is not None:
            topics.append(jaws.topic)
            at = jaws.header_ns if by_header and _runs(jaws.header_ns) else jaws.log_ns
            if (back := np.flatnonzero(np.diff(at) < 0)).size:
                raise UserError(
                    f"{path}: message {back[0] + 1} of {jaws.topic}: time goes back; expected it"
                    " never to"
                )
            opening = np.interp(times[arm] - begin, at - begin, jaws.values * 1e3)
        if len(one.values) < 2:
            raise UserError(
                f"{path}: {one.topic} has {len(one.values)} messages; expected a motion of at"
                " least 2"
            )
        if (bad := np.flatnonzero(~np.isfinite(one.values).all(axis=1))).size:
            raise UserError(
                f"{path}: message {bad[0]} of {one.topic}: got a number that is not finite"
            )
        tracks[arm] = ArmTrack(
            None if rate_hz is not None else (times[arm] - begin) * 1e-9,
            one.values[:, :3],
            unit(path, arm, one.values[:, 3:]),
            opening,
        )
    lengths = {one.topic: len(one.values) for one in raw.values()}
    if rate_hz is not None and len(set(lengths.values())) > 1:
        counts = " and ".join(f"{topic} has {count}" for topic, count in lengths.items())
        raise UserError(
            f"{path}: {counts} messages; operator.rate_hz needs as many of each. Remove it: they"
            " have times"
        )
    source = "header stamps" if by_header else "log times"
    clock = f"{source} of {topics[0]}" if rate_hz is None else f"operator.rate_hz = {rate_hz:g}"
    notes = (
        ()
        if rate_hz is None
        else (f"{source} are not used, operator.rate_hz spaces messages evenly",)
    )
    return Track(
        path,
        clock,
        tracks,
        None,
        tuple(topics),
        tuple(sorted(name for name in every if name not in topics)),
        notes,
    )


def arms_in(path: Path) -> tuple[str, ...]:
    """The arms that a file has tip poses of."""
    _, schemas = _messages(path)
    return tuple(
        arm
        for arm, prefix in ARM_TOPICS.items()
        if any(f"{prefix}{n}_cp" in schemas for n in SOURCES)
    )


class TopicValues(NamedTuple):
    """The messages of one topic."""

    topic: str
    log_ns: np.ndarray  # int64 [T]
    header_ns: np.ndarray  # int64 [T]
    values: np.ndarray  # [T, 7] m and x, y, z, w; of joint states [T] jaw opening, rad


def _runs(stamps_ns: np.ndarray) -> bool:
    """Whether headers carry times: where nobody fills them they are all alike."""
    return len(stamps_ns) > 0 and bool(stamps_ns.max() > stamps_ns.min())


def _poses(path: Path, messages: dict[str, list[Message]], topic: str) -> TopicValues:
    if topic not in messages:
        raise UserError(f"{path}: {topic} has no messages; expected the tip's poses")
    return _decoded(path, topic, messages[topic], _pose)


def _jaws(
    path: Path, messages: dict[str, list[Message]], schemas: dict[str, str], prefix: str
) -> TopicValues | None:
    for topic in (f"{prefix}{name}_js" for name in SOURCES):
        if schemas.get(topic) == JOINT_STATE and topic in messages:
            return _decoded(path, topic, messages[topic], _opening)
    return None


def _decoded(
    path: Path, topic: str, messages: list[Message], value: Callable[[Path, str, bytes], Any]
) -> TopicValues:
    if max(message.log_time for message in messages) >= 2**63:
        raise UserError(
            f"{path}: {topic} has times beyond 2^63 ns, expected nanoseconds since 1970 or the"
            " start"
        )
    values = np.array([value(path, topic, message.data) for message in messages])
    log = np.array([message.log_time for message in messages], np.int64)
    return TopicValues(
        topic, log, np.array([_stamp(message.data) for message in messages], np.int64), values
    )


def _stamp(data: bytes) -> int:
    """ns, of a message that begins with a std_msgs/Header."""
    seconds, nanoseconds = struct.unpack_from("<iI", data, 4)
    return seconds * 1_000_000_000 + nanoseconds


def _messages(path: Path) -> tuple[dict[str, list[Message]], dict[str, str]]:
    """Messages and schema name of each topic, in order of time."""
    kinds: dict[int, str] = {}
    channels: dict[int, Channel] = {}
    messages: dict[str, list[Message]] = {}
    whole = False
    try:
        with open(path, "rb") as file:
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Schema):
                    kinds[record.id] = record.name
                elif isinstance(record, Channel):
                    channels[record.id] = record
                elif isinstance(record, Message):
                    messages.setdefault(channels[record.channel_id].topic, []).append(record)
                whole = whole or isinstance(record, Footer)
    except (
        McapError,
        ValueError,
        KeyError,
        struct.error,
        OverflowError,
        MemoryError,
        *_decompression(),
    ) as error:
        what = str(error) or type(error).__name__
        raise UserError(
            f"{path}: not a complete MCAP file, perhaps truncated: {what}. Copy or record it again"
        ) from None
    if not whole:
        raise UserError(
            f"{path}: the MCAP file ends before its footer: it is truncated. Copy or record it"
            " again"
        )
    for some in messages.values():
        some.sort(key=lambda message: message.log_time)
    return messages, {
        channel.topic: kinds.get(channel.schema_id, "") for channel in channels.values()
    }


def _decompression() -> tuple[type[Exception], ...]:
    """What the decompressors of MCAP raise for damaged chunks."""
    import zstandard

    return zstandard.ZstdError, RuntimeError  # the latter is lz4's


def topic_of(path: Path, schemas: dict[str, str], prefix: str) -> str:
    """The topic of an arm's tip poses; schemas: name of each topic's. UserError."""
    wanted = [f"{prefix}{name}_cp" for name in SOURCES]
    for topic in wanted:
        if topic in schemas:
            if schemas[topic] != POSE:
                raise UserError(f"{path}: {topic} has schema {schemas[topic]!r}, expected {POSE!r}")
            return topic
    listed = ", ".join(sorted(schemas)) or "none"
    raise UserError(
        f"{path}: no topic {' or '.join(wanted)} ({POSE}); the file has"
        f" {listed}{suggestion(wanted[1], schemas)}"
    )


class _Cdr:
    """Reads a little-endian CDR message (OMG DDS-XTypes, plain CDR version 1) from its header
    on.
    """

    def __init__(self, data: bytes) -> None:
        if data[:2] != b"\x00\x01":
            raise struct.error("not little-endian CDR")
        self.data, self.at = data[4:], 8  # past the stamp
        self.text()  # frame_id

    def take(self, form: str, size: int) -> Any:
        self.at += -self.at % size
        values = struct.unpack_from("<" + form, self.data, self.at)
        self.at += struct.calcsize("<" + form)
        return values

    def text(self) -> str:
        (length,) = self.take("I", 4)
        self.at += length
        return self.data[self.at - length : self.at - 1].decode()


def _pose(path: Path, topic: str, data: bytes) -> tuple[float, ...]:
    try:
        return _Cdr(data).take("7d", 8)
    except (struct.error, UnicodeDecodeError) as error:
        raise UserError(
            f"{path}: a message of {topic} is no {POSE} in little-endian CDR: {error}"
        ) from None


def _opening(path: Path, topic: str, data: bytes) -> float:
    """Jaw opening, rad: the sum of both jaws."""
    try:
        cdr = _Cdr(data)
        names = [cdr.text() for _ in range(cdr.take("I", 4)[0])]
        (count,) = cdr.take("I", 4)
        positions = dict(zip(names, cdr.take(f"{count}d", 8), strict=True))
        return positions[JOINTS[5]] + positions[JOINTS[6]]
    except (struct.error, UnicodeDecodeError, ValueError, KeyError) as error:
        raise UserError(
            f"{path}: a message of {topic} is no {JOINT_STATE} with grasp1 and grasp2: {error}"
        ) from None
