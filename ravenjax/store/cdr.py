"""ROS 2 messages of fixed layout, encoded for all ticks at once.

Names and sizes of a trace's messages do not change from tick to tick, so each message type is one template of bytes
with holes for numbers: the holes of all ticks are filled by array assignment. Encoding is CDR, little-endian (OMG
DDS-XTypes plain CDR version 1): every number is aligned to its size, counted from the end of the four-byte header.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_HEADER = b"\x00\x01\x00\x00"  # CDR, little-endian, no options


class Layout:
    """Template of one message type: text is constant, numbers are holes filled later."""

    def __init__(self, frame_id: str) -> None:
        """Begins with a std_msgs/Header: stamp, then the constant `frame_id`."""
        self._bytes = bytearray(8)  # stamp: int32 sec, uint32 nanosec
        self._holes: list[tuple[int, int, int]] = []  # first byte, how many numbers, bytes of each
        self.text(frame_id)

    def _align(self, size: int) -> None:
        self._bytes += bytes(-len(self._bytes) % size)

    def count(self, value: int) -> None:
        """The length of a sequence."""
        self._align(4)
        self._bytes += value.to_bytes(4, "little")

    def text(self, value: str) -> None:
        """A constant string."""
        encoded = value.encode() + b"\0"
        self.count(len(encoded))
        self._bytes += encoded

    def texts(self, values: Sequence[str]) -> None:
        """A constant sequence of strings."""
        self.count(len(values))
        for value in values:
            self.text(value)

    def numbers(self, how_many: int) -> None:
        """A hole of `how_many` float64 in a row."""
        self._hole(how_many, 8)

    def singles(self, how_many: int) -> None:
        """A hole of `how_many` float32 in a row."""
        self._hole(how_many, 4)

    def _hole(self, how_many: int, size: int) -> None:
        if how_many:
            self._align(size)
            self._holes.append((len(self._bytes), how_many, size))
            self._bytes += bytes(size * how_many)

    def sequence(self, how_many: int) -> None:
        """A sequence of float64: its length and its hole."""
        self.count(how_many)
        self.numbers(how_many)

    def encode(self, time_ns: np.ndarray, values: np.ndarray) -> list[bytes]:
        """One message per tick: `time_ns` int64 [T], `values` [T, sum of the holes] in order of the holes."""
        ticks = len(time_ns)
        rows = np.tile(np.frombuffer(bytes(self._bytes), np.uint8), (ticks, 1))
        stamp = np.stack([time_ns // 1_000_000_000, time_ns % 1_000_000_000], axis=1).astype("<u4")
        rows[:, :8] = stamp.view(np.uint8)
        column = 0
        for start, how_many, size in self._holes:
            filled = np.ascontiguousarray(values[:, column : column + how_many], f"<f{size}")
            rows[:, start : start + size * how_many] = filled.view(np.uint8)
            column += how_many
        if column != values.shape[1]:
            raise ValueError(f"message layout has {column} numbers, got {values.shape[1]}")
        return [_HEADER + row.tobytes() for row in rows]


def string(text: str) -> bytes:
    """A whole message that is one string, std_msgs/String."""
    encoded = text.encode() + b"\0"
    return _HEADER + len(encoded).to_bytes(4, "little") + encoded


def read_string(message: bytes) -> str:
    """The text of a message that `string` made. ValueError where it is none."""
    if message[:4] != _HEADER or len(message) < 9:
        raise ValueError("not a string in little-endian CDR")
    return message[8 : 7 + int.from_bytes(message[4:8], "little")].decode()
