"""Where numbers stand in the buffers of vector code."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from functools import cached_property

import numpy as np


@dataclasses.dataclass(frozen=True)
class Place:
    """An address, a pointer of the function plus a constant of bytes; `splat`: one number for
    all lanes.
    """

    pointer: str
    offset: int = 0
    splat: bool = False


@dataclasses.dataclass(frozen=True)
class BufferLayout:
    """Where numbers of these types stand in a buffer of one number a lane, one after the other."""

    types: tuple[str, ...]
    width: int

    @cached_property
    def offsets(self) -> tuple[int, ...]:
        """Bytes from the start, one entry a number."""
        return tuple(
            np.cumsum([0, *(size(dtype) * self.width for dtype in self.types)])[:-1].tolist()
        )

    @cached_property
    def bytes(self) -> int:
        """Size of the buffer."""
        return sum(size(dtype) for dtype in self.types) * self.width

    def places(self, pointer: str, splat: bool = False) -> list[Place]:
        """The place of each number."""
        return [Place(pointer, offset, splat) for offset in self.offsets]

    def words(self, lane: int) -> np.ndarray:
        """Where the 32-bit words of one lane's numbers stand: one after the other they are a
        buffer of width 1.
        """
        sizes = np.array([size(dtype) // 4 for dtype in self.types], np.int64)
        first = np.array(self.offsets, np.int64) // 4 + lane * sizes
        within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        return np.repeat(first, sizes) + within


@dataclasses.dataclass(frozen=True)
class RowLayout:
    """Where numbers of these types stand in a row of bytes, each at an offset of its own."""

    types: tuple[str, ...]
    offsets: tuple[int, ...]  # bytes from the start, one entry a number
    bytes: int  # from one row to the next

    @classmethod
    def packed(cls, types: Iterable[str]) -> RowLayout:
        """One after the other, each aligned to its size."""
        types, offsets, end = tuple(types), [], 0
        for dtype in types:
            offsets.append(-(-end // size(dtype)) * size(dtype))
            end = offsets[-1] + size(dtype)
        return cls(types, tuple(offsets), -(-end // 8) * 8)

    @property
    def dtype(self) -> np.dtype:
        """A row as NumPy reads it, one field a number; a truth value is an int32."""
        formats = [stored(dtype) for dtype in self.types]
        names = [f"f{k}" for k in range(len(formats))]
        return np.dtype(
            {
                "names": names,
                "formats": formats,
                "offsets": list(self.offsets),
                "itemsize": self.bytes,
            }
        )

    def places(self, pointer: str) -> list[Place]:
        """The place of each number."""
        return [Place(pointer, offset) for offset in self.offsets]


def buffer(rows: int, size: int) -> np.ndarray:
    """Zeroed bytes [rows, size], on a cache line."""
    raw = np.zeros(rows * size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + rows * size].reshape(rows, size)


def stored(dtype: str) -> np.dtype:
    """The type of a number in memory."""
    return np.dtype(np.int32 if dtype == "bool" else dtype)


def size(dtype: str) -> int:
    """Bytes of a number in memory; a truth value is an int32, all bits set or none."""
    return 8 if dtype.endswith("64") else 4
