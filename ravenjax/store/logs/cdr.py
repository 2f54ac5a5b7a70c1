"""ROS 2 messages of fixed layout, encoded for all ticks at once.

Names and sizes of a log's messages do not change from tick to tick, so each message type is one
template of bytes with holes for times and numbers: the holes of all ticks are filled by array
assignment. Encoding is CDR, little-endian (OMG DDS-XTypes plain CDR version 1): every number is
aligned to its size, counted from the end of the four-byte header.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

_HEADER = b"\x00\x01\x00\x00"  # CDR, little-endian, no options
_SECOND_NS = 1_000_000_000


class MessageLayout:
    """Template of one message type: text is constant, times and numbers are holes filled later."""

    def __init__(self) -> None:
        """An empty message."""
        self._bytes = bytearray()
        self._stamps: list[int] = []  # first byte of each time
        self._holes: list[tuple[int, int, int]] = []  # first byte, how many numbers, bytes of each

    def _align(self, size: int) -> None:
        self._bytes += bytes(-len(self._bytes) % size)

    def header(self, frame_id: str) -> None:
        """A std_msgs/Header: the time of the message, then the constant `frame_id`."""
        self._align(4)
        self._stamps.append(len(self._bytes))
        self._bytes += bytes(8)  # int32 sec, uint32 nanosec
        self.text(frame_id)

    def byte(self, value: int) -> None:
        """A constant uint8."""
        self._bytes.append(value)

    def count(self, value: int) -> None:
        """A constant uint32, such as the length of a sequence."""
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
        """One message per tick: `time_ns` int64 [T], `values` [T, sum of the holes] in order of
        the holes.
        """
        ticks = len(time_ns)
        rows = np.tile(np.frombuffer(bytes(self._bytes), np.uint8), (ticks, 1))
        stamp = (
            np.stack([time_ns // _SECOND_NS, time_ns % _SECOND_NS], axis=1)
            .astype("<u4")
            .view(np.uint8)
        )
        for start in self._stamps:
            rows[:, start : start + 8] = stamp
        column = 0
        for start, how_many, size in self._holes:
            numbers = np.ascontiguousarray(values[:, column : column + how_many], f"<f{size}")
            rows[:, start : start + size * how_many] = numbers.view(np.uint8)
            column += how_many
        if column != values.shape[1]:
            raise ValueError(f"message layout has {column} numbers, got {values.shape[1]}")
        return [_HEADER + row.tobytes() for row in rows]


def log(time_ns: int, level: int, name: str, text: str) -> bytes:
    """A whole rcl_interfaces/Log: `level` 10 debug, 20 info, 30 warn, 40 error, 50 fatal; no
    file, function, line.
    """
    layout = MessageLayout()
    for part in divmod(time_ns, _SECOND_NS):
        layout.count(part)
    layout.byte(level)
    for constant in (name, text, "", ""):
        layout.text(constant)
    layout.count(0)  # line
    return layout.encode(np.zeros(1, np.int64), np.zeros((1, 0)))[0]


def string(text: str) -> bytes:
    """A whole message that is one string, std_msgs/String."""
    encoded = text.encode() + b"\0"
    return _HEADER + len(encoded).to_bytes(4, "little") + encoded


def read_string(message: bytes) -> str:
    """The text of a message that `string` made. ValueError where it is none."""
    if message[:4] != _HEADER or len(message) < 9:
        raise ValueError("not a string in little-endian CDR")
    return message[8 : 7 + int.from_bytes(message[4:8], "little")].decode()
