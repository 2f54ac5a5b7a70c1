"""The operator's tip motion in an MCAP file of CRTK topics, as the columns of `motion_table`."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any

import numpy as np
from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Message, Schema
from mcap.stream_reader import StreamReader

from ravenjax.errors import UserError, suggestion
from ravenjax.types import JOINTS, ArmName

ARM_TOPICS = {"gold": "/arm1/", "green": "/arm2/"}
"""CRTK's arm1 is raven2's gold."""

POSE, JOINT_STATE = "geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/JointState"


def columns(path: Path, arms: tuple[ArmName, ...]) -> dict[str, np.ndarray]:
    """Columns time_ns, <arm>_x_m .., <arm>_qx .. and, where there are joint states, <arm>_grasp_rad."""
    messages, schemas = _messages(path)
    out: dict[str, np.ndarray] = {}
    stamps = np.zeros(0, np.int64)
    for i, arm in enumerate(arms):
        topic = _topic(path, schemas, ARM_TOPICS[arm], "cp", POSE)
        if topic not in messages:
            raise UserError(f"{path}: {topic} has no messages; expected the tip's poses")
        if max(message.log_time for message in messages[topic]) >= 2**63:
            raise UserError(f"{path}: {topic} has times beyond 2^63 ns, expected nanoseconds since 1970 or the start")
        time = np.array([message.log_time for message in messages[topic]], np.int64)
        if i == 0:
            stamps = time
        values = np.array([_pose(path, topic, message.data) for message in messages[topic]])
        if len(time) != len(stamps):
            raise UserError(f"{path}: {topic} has {len(time)} messages, expected {len(stamps)} as the other arm has")
        names = ["x_m", "y_m", "z_m", "qx", "qy", "qz", "qw"]
        out |= {f"{arm}_{name}": values[:, i] for i, name in enumerate(names)}
        states = [f"{ARM_TOPICS[arm]}{name}_js" for name in ("setpoint", "measured")]
        jaws = next((topic for topic in states if schemas.get(topic) == JOINT_STATE and topic in messages), None)
        if jaws is not None:
            opening = [_opening(path, jaws, message.data) for message in messages[jaws]]
            at = [message.log_time for message in messages[jaws]]
            out[f"{arm}_grasp_rad"] = np.interp(stamps - stamps[0], np.array(at, np.int64) - stamps[0], opening)
    return {"time_ns": stamps, **out}


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
    except (McapError, ValueError, KeyError, struct.error, OverflowError, MemoryError, *_decompression()) as error:
        what = str(error) or type(error).__name__
        raise UserError(
            f"{path}: not a complete MCAP file, perhaps truncated: {what}. Copy or record it again"
        ) from None
    if not whole:
        raise UserError(f"{path}: the MCAP file ends before its footer: it is truncated. Copy or record it again")
    for found in messages.values():
        found.sort(key=lambda message: message.log_time)
    return messages, {channel.topic: kinds.get(channel.schema_id, "") for channel in channels.values()}


def _decompression() -> tuple[type[Exception], ...]:
    """What the decompressors of MCAP raise for damaged chunks."""
    import zstandard

    return zstandard.ZstdError, RuntimeError  # the latter is lz4's


def _topic(path: Path, schemas: dict[str, str], prefix: str, kind: str, schema: str) -> str:
    wanted = [f"{prefix}setpoint_{kind}", f"{prefix}measured_{kind}"]
    for topic in wanted:
        if topic in schemas:
            if schemas[topic] != schema:
                raise UserError(f"{path}: {topic} has schema {schemas[topic]!r}, expected {schema!r}")
            return topic
    listed = ", ".join(sorted(schemas)) or "none"
    raise UserError(
        f"{path}: no topic {' or '.join(wanted)} ({schema}); the file has {listed}{suggestion(wanted[1], schemas)}"
    )


class _Cdr:
    """Reads a little-endian CDR message (OMG DDS-XTypes, plain CDR version 1) from its header on."""

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
        raise UserError(f"{path}: a message of {topic} is no {POSE} in little-endian CDR: {error}") from None


def _opening(path: Path, topic: str, data: bytes) -> float:
    """Jaw opening, rad: the sum of both jaws."""
    try:
        cdr = _Cdr(data)
        names = [cdr.text() for _ in range(cdr.take("I", 4)[0])]
        (count,) = cdr.take("I", 4)
        positions = dict(zip(names, cdr.take(f"{count}d", 8), strict=True))
        return positions[JOINTS[5]] + positions[JOINTS[6]]
    except (struct.error, UnicodeDecodeError, ValueError, KeyError) as error:
        raise UserError(f"{path}: a message of {topic} is no {JOINT_STATE} with grasp1 and grasp2: {error}") from None
