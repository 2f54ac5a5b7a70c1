"""Where numbers stand in the buffers of compiled code."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np


@dataclasses.dataclass(frozen=True)
class Place:
    """An address: a pointer of the function plus a constant of bytes; `splat`: one number for
    all lanes.
    """

    pointer: str
    offset: int = 0
    splat: bool = False


@dataclasses.dataclass(frozen=True)
class BufferLayout:
    """Where numbers of these types stand in a row of bytes, each once for every lane."""

    types: tuple[str, ...]
    offsets: tuple[int, ...]  # bytes from the start, one entry a number
    bytes: int  # from one row to the next
    width: int = 1  # lanes

    @classmethod
    def of_lanes(cls, types: Iterable[str], width: int) -> BufferLayout:
        """One after the other, without gaps."""
        types = tuple(types)
        ends = np.cumsum([0, *(size(dtype) * width for dtype in types)]).tolist()
        return cls(types, tuple(ends[:-1]), ends[-1], width)

    @classmethod
    def aligned(cls, types: Iterable[str]) -> BufferLayout:
        """One after the other, each aligned to its size, for one lane."""
        types, offsets, end = tuple(types), [], 0
        for dtype in types:
            offsets.append(-(-end // size(dtype)) * size(dtype))
            end = offsets[-1] + size(dtype)
        return cls(types, tuple(offsets), -(-end // 8) * 8)

    @property
    def dtype(self) -> np.dtype:
        """A row of one lane as NumPy reads it, one field a number."""
        return np.dtype(
            {
                "names": [f"f{k}" for k in range(len(self.types))],
                "formats": [stored(dtype) for dtype in self.types],
                "offsets": list(self.offsets),
                "itemsize": self.bytes,
            }
        )

    def places(self, pointer: str, splat: bool = False) -> list[Place]:
        """The place of each number."""
        return [Place(pointer, offset, splat) for offset in self.offsets]

    def views(self, rows: np.ndarray) -> list[np.ndarray]:
        """The numbers in memory, each [rows, width]; `rows` is [rows, bytes]."""
        types = [stored(dtype) for dtype in self.types]
        return [
            rows[:, offset : offset + self.width * dtype.itemsize].view(dtype)
            for offset, dtype in zip(self.offsets, types, strict=True)
        ]

    def pack(self, columns: Iterable[np.ndarray], rows: int) -> np.ndarray:
        """A buffer [rows, bytes] of these columns, each [rows * width]."""
        data = buffer(rows, self.bytes)
        for view, column in zip(self.views(data), columns, strict=True):
            view[...] = column.reshape(rows, self.width)
        return data

    def unpack(self, data: np.ndarray) -> list[np.ndarray]:
        """The columns of a buffer, each [rows * width]."""
        views = zip(self.views(data), self.types, strict=True)
        return [view.reshape(-1).astype(dtype) for view, dtype in views]

    def words(self, lane: int) -> np.ndarray:
        """Where the 32-bit words of one lane's numbers stand: one after the other they are a
        buffer of width 1.
        """
        sizes = np.array([size(dtype) // 4 for dtype in self.types], np.int64)
        first = np.array(self.offsets, np.int64) // 4 + lane * sizes
        within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        return np.repeat(first, sizes) + within


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
