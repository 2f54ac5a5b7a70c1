"""Describes where each number of a program lies in the buffers of compiled code."""

import dataclasses
from collections.abc import Iterable

import numpy as np


@dataclasses.dataclass(frozen=True)
class Place:
    """A memory address: pointer and offset in bytes. splat: all lanes read the same number."""

    pointer: str
    offset: int = 0
    splat: bool = False


@dataclasses.dataclass(frozen=True)
class BufferLayout:
    """Layout of a row of bytes that contains each number once for every lane."""

    types: tuple[str, ...]
    offsets: tuple[int, ...]  # bytes from the start of the row, one per number
    bytes: int  # from one row to the next
    width: int = 1  # lanes

    @classmethod
    def of_lanes(cls, types: Iterable[str], width: int) -> "BufferLayout":
        """Make a layout of consecutive numbers without gaps."""
        types = tuple(types)
        ends = np.cumsum([0, *(stored_size(dtype) * width for dtype in types)]).tolist()
        return cls(types, tuple(ends[:-1]), ends[-1], width)

    @classmethod
    def aligned(cls, types: Iterable[str]) -> "BufferLayout":
        """Make a layout for one lane in which each number begins at a multiple of its size."""
        types, offsets, end = tuple(types), [], 0
        for dtype in types:
            offsets.append(-(-end // stored_size(dtype)) * stored_size(dtype))
            end = offsets[-1] + stored_size(dtype)
        # Rows have a multiple of 8 bytes, so that the numbers of the next row are aligned, too.
        return cls(types, tuple(offsets), -(-end // 8) * 8)

    @property
    def dtype(self) -> np.dtype:
        """NumPy's type of a row with one lane: one field per number."""
        names = [f"f{k}" for k in range(len(self.types))]
        formats = list(map(stored_type, self.types))
        offsets, size = list(self.offsets), self.bytes
        return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})

    def places(self, pointer: str, splat: bool = False) -> list[Place]:
        """Return the place of each number."""
        return [Place(pointer, offset, splat) for offset in self.offsets]

    def views(self, rows: np.ndarray) -> list[np.ndarray]:
        """Return views of the numbers in memory, each [rows, width]; `rows` is [rows, bytes]."""
        types = [stored_type(dtype) for dtype in self.types]
        return [
            rows[:, offset : offset + self.width * dtype.itemsize].view(dtype)
            for offset, dtype in zip(self.offsets, types, strict=True)
        ]

    def pack(self, columns: Iterable[np.ndarray], rows: int) -> np.ndarray:
        """Pack columns, each [rows * width], into a buffer [rows, bytes]."""
        data = aligned_buffer(rows, self.bytes)
        for view, column in zip(self.views(data), columns, strict=True):
            view[...] = column.reshape(rows, self.width)
        return data

    def unpack(self, data: np.ndarray) -> list[np.ndarray]:
        """Return the columns of a buffer, each [rows * width]."""
        views = zip(self.views(data), self.types, strict=True)
        return [view.reshape(-1).astype(dtype) for view, dtype in views]

    def words(self, lane: int) -> np.ndarray:
        """Return the indices of the 32-bit words of a row that contain the numbers of one lane."""
        # In the row a0 a1 b0 b0 b1 b1, with a of one word and b of two, lane 1 has 1, 4 and 5.
        sizes = np.array([stored_size(dtype) // 4 for dtype in self.types], np.int64)
        # First word of each number, and the position of each word within its number.
        first = np.array(self.offsets, np.int64) // 4 + lane * sizes
        within = np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        return np.repeat(first, sizes) + within


def aligned_buffer(rows: int, size: int) -> np.ndarray:
    """Return zeroed bytes [rows, size] that begin on a cache line, a multiple of 64 bytes."""
    raw = np.zeros(rows * size + 64, np.uint8)
    start = -raw.ctypes.data % 64
    return raw[start : start + rows * size].reshape(rows, size)


def stored_type(dtype: str) -> np.dtype:
    """Return the type of a number in memory."""
    return np.dtype(np.int32 if dtype == "bool" else dtype)


def stored_size(dtype: str) -> int:
    """Return the bytes of a number in memory. A truth value is an int32, all bits set or none."""
    return 8 if dtype.endswith("64") else 4
