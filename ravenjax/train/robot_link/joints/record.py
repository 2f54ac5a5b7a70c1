"""What a robot reports once a millisecond, as bytes of fixed layout: `RECORD`, and text records on
the same stream.

Everything is little-endian and packed. A stream may be joined anywhere: `joint_decoder` finds the
next whole record.

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

from ravenjax.robots.raven2.arms import ARMS, ArmName
from ravenjax.train.protocol.frame import Frame, FrameLayout

MAGIC, TEXT_MAGIC, VERSION = b"RVNJ", b"RVNA", 1
ARM = np.dtype(
    [
        ("jpos", "<f4", 7),
        ("jpos_d", "<f4", 7),
        ("mpos", "<f4", 7),
        ("mvel", "<f4", 7),
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
"""Bytes of a record."""
_JOINTS = ("jpos", "jpos_d", "mpos", "mvel")
HEAD = struct.Struct("<4sHH")
_NUMBERS = struct.Struct("<4sHHIBBHI")  # of RECORD up to its arms
_WHOLE = struct.Struct("<3i7h")  # position and counts of an arm
CRC = struct.Struct("<I")
_ARMS_AT, _CRC_AT = _NUMBERS.size, RECORD.itemsize - CRC.size
_INT32, _INT16 = 2**31 - 1, 2**15 - 1


class Reporter:
    """Makes the record of each frame of one robot."""

    def __init__(self, layout: FrameLayout) -> None:
        """layout: of the frames."""
        self._record = bytearray(RECORD.itemsize)
        self._places = layout.places
        self._there = sum(1 << ARM_SHIFT + ARMS.index(arm) for arm in layout.arms)
        self._arms = [self._arm(arm) for arm in layout.arms]

    def _arm(self, arm: ArmName) -> tuple[np.ndarray, np.ndarray, int, slice, slice]:
        """Where the joints go to and come from, then where position and counts do."""
        begin = _ARMS_AT + ARMS.index(arm) * ARM.itemsize
        joints = np.frombuffer(self._record, "<f4", 7 * len(_JOINTS), begin)
        sources = np.concatenate([np.r_[self._places[f"{arm}/{name}"]] for name in _JOINTS])
        whole = begin + ARM.fields["position_um"][1]  # type: ignore[index]
        return joints, sources, whole, self._places[f"{arm}/position"], self._places[f"{arm}/dac"]

    def encode(self, frame: Frame, tick: int, last_seq: int) -> bytes:
        """The record of a frame; tick and last_seq as above."""
        flags = self._there | int(frame.number("plc_runlevel")) << PLC_SHIFT
        for name, bit in FLAGS.items():
            if frame.number(name):
                flags |= bit
        runlevel, surgeon_mode = int(frame.number("runlevel")), int(frame.number("surgeon_mode"))
        head = (
            MAGIC,
            VERSION,
            RECORD.itemsize,
            tick % 2**32,
            runlevel,
            surgeon_mode & 0xFF,
            flags,
            last_seq % 2**32,
        )
        _NUMBERS.pack_into(self._record, 0, *head)
        for joints, sources, whole, position, dac in self._arms:
            np.take(frame.row, sources, out=joints)
            um = [round(max(-_INT32, min(_INT32, x * 1e6))) for x in frame.row[position].tolist()]
            counts = [int(max(-_INT16, min(_INT16, x))) for x in frame.row[dac].tolist()]
            _WHOLE.pack_into(self._record, whole, *um, *counts)
        CRC.pack_into(self._record, _CRC_AT, zlib.crc32(memoryview(self._record)[:_CRC_AT]))
        return bytes(self._record)


class JointReport:
    """A record that arrived; `report["gold"]["jpos"]`, field names as above."""

    __slots__ = ("record",)

    def __init__(self, record: np.void) -> None:
        self.record = record

    def __getitem__(self, arm: ArmName) -> np.void:
        return self.record["arms"][ARMS.index(arm)]

    @property
    def tick(self) -> int:
        """ms since the robot's process began."""
        return int(self.record["tick"])

    @property
    def last_seq(self) -> int:
        """Number of the console's packet that the robot took last."""
        return int(self.record["last_seq"])

    @property
    def runlevel(self) -> int:
        """0 to 3."""
        return int(self.record["runlevel"])

    @property
    def arms(self) -> tuple[ArmName, ...]:
        """Those that are there."""
        flags = int(self.record["flags"])
        return tuple(arm for i, arm in enumerate(ARMS) if flags >> ARM_SHIFT + i & 1)

    def fill(self, frame: Frame) -> None:
        """Write what is reported into the channels of `frame`; arms that the frame lacks are left
        out.

        Where links and tip truly are is not reported: they count as where they were measured.
        """
        flags = int(self.record["flags"])
        for name, bit in FLAGS.items():
            frame[name] = bool(flags & bit)
        frame["plc_runlevel"] = flags >> PLC_SHIFT & 3
        frame["runlevel"], frame["surgeon_mode"] = (
            self.record["runlevel"],
            self.record["surgeon_mode"],
        )
        frame["tick"], frame["last_seq"] = self.tick, self.last_seq
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
    size = HEAD.size + len(text) + CRC.size
    if size > LONGEST:
        raise ValueError(
            f"text of {len(text)} bytes, expected at most {LONGEST - HEAD.size - CRC.size}"
        )
    whole = HEAD.pack(TEXT_MAGIC, VERSION, size) + text
    return whole + CRC.pack(zlib.crc32(whole))
