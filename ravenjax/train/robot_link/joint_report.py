"""What a robot reports once a millisecond, as bytes of fixed layout: `RECORD`, and text records on
the same stream.

Everything is little-endian and packed.

    RECORD        offset  type    what
    magic              0  4 bytes "RVNJ"
    version            4  u16     1
    size               6  u16     bytes of the record, magic and checksum included: 304
    tick               8  u32     ms since the robot's process began
    runlevel          12  u8      0 E-stop, 1 init, 2 pedal up, 3 pedal down
    surgeon_mode      13  u8      1: the robot has heard that the pedal is down
    flags             14  u16     see `FLAGS`; bits 4, 5: run level of the PLC; bit 8: gold is there, bit 9: green is
    last_seq          16  u32     number of the console's packet that the robot took last; 111 before the first one
    arms              20  2 x 140 gold, green; zeros where the arm is not there
      jpos             0  f32[7]  joints as measured: rad, insertion m
      jpos_d          28  f32[7]  as wanted
      mpos            56  f32[7]  motors as measured, rad
      mvel            84  f32[7]  as the control software estimates, rad/s
      position_um    112  i32[3]  tip as measured, frame 0 of the arm
      dac            124  i16[7]  counts written to the motors
      spare          138  2 bytes
    crc32            300  u32     of everything before it, as zlib has it

    TEXT: magic "RVNA", version, size as above, then a JSON object in UTF-8, then crc32.

Names and units are those of raven2's `ravenstate`, without its factor of 180/pi.
"""  # noqa: E501

from __future__ import annotations

import json
import struct
import zlib
from typing import Any

import numpy as np

from ravenjax.train.protocol.frame import Frame, FrameLayout
from ravenjax.train.robot import ARMS, ArmName

MAGIC, TEXT_MAGIC, VERSION = b"RVNJ", b"RVNA", 1
_JOINTS = ("jpos", "jpos_d", "mpos", "mvel")
ARM = np.dtype(
    [
        *((name, "<f4", 7) for name in _JOINTS),
        ("position_um", "<i4", 3),
        ("dac", "<i2", 7),
        ("spare", "V2"),
    ]
)
RECORD = np.dtype(
    [
        ("magic", "S4"),
        ("version", "<u2"),
        ("size", "<u2"),
        ("tick", "<u4"),
        ("runlevel", "u1"),
        ("surgeon_mode", "u1"),
        ("flags", "<u2"),
        ("last_seq", "<u4"),
        ("arms", ARM, 2),
        ("crc32", "<u4"),
    ]
)
FLAGS = {"soft_estopped": 1 << 0, "brakes": 1 << 1, "fault_active": 1 << 2}
"""Bits of `flags` by channel of the frame."""
PLC_SHIFT, ARM_SHIFT = 4, 8
LONGEST = 8192
"""Bytes of a text record."""
_HEAD, _CRC = struct.Struct("<4sHH"), struct.Struct("<I")
_INT32, _INT16 = 2**31 - 1, 2**15 - 1


def flags_of(arms: tuple[ArmName, ...]) -> int:
    """The bits that say which arms are there."""
    return sum(1 << ARM_SHIFT + ARMS.index(arm) for arm in arms)


class Reporter:
    """Makes the record of each frame of one robot."""

    def __init__(self, layout: FrameLayout) -> None:
        """layout: of the frames."""
        self._bytes = bytearray(RECORD.itemsize)
        self._record = np.frombuffer(self._bytes, RECORD)
        self._record["magic"], self._record["version"] = MAGIC, VERSION
        self._record["size"] = RECORD.itemsize
        self._present = flags_of(layout.arms)
        self._joints: list[tuple[np.ndarray, slice]] = []
        self._whole: list[tuple[np.ndarray, slice, float, int]] = []
        for arm in layout.arms:
            there, places = self._record["arms"][0, ARMS.index(arm)], layout.places
            self._joints += [(there[name], places[f"{arm}/{name}"]) for name in _JOINTS]
            self._whole += [
                (there["position_um"], places[f"{arm}/position"], 1e6, _INT32),
                (there["dac"], places[f"{arm}/dac"], 1.0, _INT16),
            ]

    def encode(self, frame: Frame, tick: int, last_seq: int) -> bytes:
        """The record of a frame; tick and last_seq as above."""
        flags = self._present | int(frame.number("plc_runlevel")) << PLC_SHIFT
        for name, bit in FLAGS.items():
            if frame.number(name):
                flags |= bit
        record, row = self._record, frame.row
        record["tick"], record["last_seq"], record["flags"] = tick % 2**32, last_seq % 2**32, flags
        record["runlevel"] = int(frame.number("runlevel"))
        record["surgeon_mode"] = int(frame.number("surgeon_mode")) & 0xFF
        for target, place in self._joints:
            target[:] = row[place]
        for target, place, scale, most in self._whole:
            target[:] = [round(max(-most, min(most, x * scale))) for x in row[place].tolist()]
        record["crc32"] = zlib.crc32(memoryview(self._bytes)[: -_CRC.size])
        return bytes(self._bytes)


class JointReport:
    """A record that arrived; `report["gold"]["jpos"]`, field names as above."""

    def __init__(self, record: np.void) -> None:
        self.record = record
        self.tick, self.last_seq = int(record["tick"]), int(record["last_seq"])
        self.runlevel, self.flags = int(record["runlevel"]), int(record["flags"])

    def __getitem__(self, arm: ArmName) -> np.void:
        return self.record["arms"][ARMS.index(arm)]

    @property
    def arms(self) -> tuple[ArmName, ...]:
        """Those that are there."""
        return tuple(arm for i, arm in enumerate(ARMS) if self.flags >> ARM_SHIFT + i & 1)

    def fill(self, frame: Frame) -> None:
        """Write what is reported into the channels of `frame`; arms that it lacks are left out.

        Where links and tip truly are is not reported: they count as where they were measured.
        """
        for name, bit in FLAGS.items():
            frame[name] = bool(self.flags & bit)
        frame["plc_runlevel"] = self.flags >> PLC_SHIFT & 3
        for name in ("runlevel", "surgeon_mode", "tick", "last_seq"):
            frame[name] = self.record[name]
        for arm in self.arms:
            if arm in frame.layout.arms:
                values = self[arm]
                for name in (*_JOINTS, "dac"):
                    frame[f"{arm}/{name}"] = values[name]
                frame[f"{arm}/link_jpos"] = values["jpos"]
                frame[f"{arm}/position"] = frame[f"{arm}/tip"] = values["position_um"] * 1e-6


def encode_text(content: dict[str, Any]) -> bytes:
    """A text record; ValueError where it is too long."""
    text = json.dumps(content, separators=(",", ":")).encode()
    size = _HEAD.size + len(text) + _CRC.size
    if size > LONGEST:
        raise ValueError(f"a text record of {size} bytes, expected at most {LONGEST}")
    whole = _HEAD.pack(TEXT_MAGIC, VERSION, size) + text
    return whole + _CRC.pack(zlib.crc32(whole))


class Decoder:
    """Cuts a stream of bytes into its records."""

    def __init__(self) -> None:
        self._bytes = bytearray()

    def feed(self, content: bytes) -> list[JointReport | dict[str, Any]]:
        """The records that these bytes complete: joint reports, and text records as dicts.
        ValueError where the stream holds anything else.
        """
        self._bytes += content
        records: list[JointReport | dict[str, Any]] = []
        while len(self._bytes) >= _HEAD.size:
            magic, version, size = _HEAD.unpack_from(self._bytes)
            is_text = magic == TEXT_MAGIC and _HEAD.size + _CRC.size <= size <= LONGEST
            is_report = magic == MAGIC and size == RECORD.itemsize
            if version != VERSION or not (is_text or is_report):
                raise ValueError(f"no record begins with {bytes(self._bytes[: _HEAD.size])!r}")
            if len(self._bytes) < size:
                break
            record = bytes(self._bytes[:size])
            del self._bytes[:size]
            if zlib.crc32(record[: -_CRC.size]) != _CRC.unpack(record[-_CRC.size :])[0]:
                raise ValueError("a record with a wrong checksum")
            if is_report:
                records.append(JointReport(np.frombuffer(record, RECORD)[0]))
                continue
            text = json.loads(record[_HEAD.size : -_CRC.size])
            if not isinstance(text, dict):
                raise ValueError("a text record that is no JSON object")
            records.append(text)
        return records
