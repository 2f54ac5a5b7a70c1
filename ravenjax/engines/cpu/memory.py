"""Where numbers stand in the buffers of vector code."""

from __future__ import annotations

import dataclasses

import numpy as np


@dataclasses.dataclass(frozen=True)
class Place:
    """An address, a pointer of the function plus a constant of bytes; `splat`: one number for all lanes."""

    pointer: str
    offset: int = 0
    splat: bool = False


@dataclasses.dataclass(frozen=True)
class BufferLayout:
    """Where numbers of these types stand in a buffer of one number a lane, one after the other."""

    types: tuple[str, ...]
    width: int

    @property
    def offsets(self) -> tuple[int, ...]:
        """Bytes from the start, one entry a number."""
        return tuple(np.cumsum([0, *(size(dtype) * self.width for dtype in self.types)])[:-1].tolist())

    @property
    def bytes(self) -> int:
        """Size of the buffer."""
        return sum(size(dtype) for dtype in self.types) * self.width

    def places(self, pointer: str, splat: bool = False) -> list[Place]:
        """The place of each number."""
        return [Place(pointer, offset, splat) for offset in self.offsets]


def size(dtype: str) -> int:
    """Bytes of a number in memory; a truth value is an int32, all bits set or none."""
    return 8 if dtype == "float64" else 4
