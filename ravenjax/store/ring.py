"""Defines ring buffers in shared memory. One process writes, others read, and no process waits.

Reading a ring costs less time than a system call, which matters a thousand times a second. Rows
are numbered, so a slow reader notices that the writer has overwritten rows.
"""

import json
import multiprocessing
from collections.abc import Iterator
from multiprocessing import shared_memory
from typing import Any

import numpy as np

Json = dict[str, Any]
_encode = json.JSONEncoder(separators=(",", ":")).encode
# Bytes of the header: three integers (rows written so far, capacity, bytes of a row) and space.
_HEADER = 64
EVENT_BYTES = 2048
"""The largest size of an event as JSON, bytes."""
COMMAND_BYTES = 4096  # The largest size of a command as JSON, bytes


class Ring:
    """The last `capacity` rows of bytes that a process has written."""

    def __init__(self, memory: shared_memory.SharedMemory, owner: bool):
        self._memory, self._owner = memory, owner
        self._header = np.ndarray((3,), np.int64, memory.buf)
        self.capacity, self.row_bytes = int(self._header[1]), int(self._header[2])
        self._rows = np.ndarray((self.capacity, self.row_bytes), np.uint8, memory.buf, _HEADER)
        self._written = int(self._header[0])  # rows written by this process

    @staticmethod
    def create(capacity: int, row_bytes: int) -> "Ring":
        """Create a ring. Other processes attach by its `name`."""
        size = _HEADER + capacity * row_bytes
        memory = shared_memory.SharedMemory(create=True, size=size)
        # This touches every page of memory before the first tick needs it.
        np.ndarray((size,), np.uint8, memory.buf)[:] = 0
        np.ndarray((3,), np.int64, memory.buf)[:] = 0, capacity, row_bytes
        return Ring(memory, owner=True)

    @staticmethod
    def attach(name: str) -> "Ring":
        """Attach to a ring of this process or its parent. Only the creator removes it."""
        return Ring(shared_memory.SharedMemory(name=name), owner=False)

    @property
    def name(self) -> str:
        """The name for `attach`."""
        return self._memory.name

    @property
    def written(self) -> int:
        return int(self._header[0])

    def put(self, row: np.ndarray) -> None:
        """Append a row, uint8. Bytes beyond a shorter row keep their old values."""
        self._rows[self._written % self.capacity, : row.size] = row
        self._written += 1
        self._header[0] = self._written

    def read(self, first: int, limit: int | None = None) -> tuple[int, np.ndarray]:
        """Return the number of the first returned row, and copied rows, uint8 [n, row_bytes]. The
        rows are those from number `first` on, at most `limit`. If the writer has overwritten some,
        the returned number is larger than `first`.
        """
        # One row less than the capacity, because the writer may be writing the oldest row.
        end = self.written
        first = max(first, end - self.capacity + 1, 0)
        last = end if limit is None else min(end, first + limit)
        rows = self._rows[np.arange(first, last) % self.capacity].copy()
        # Rows that were overwritten during the copy are left out.
        lost = max(0, self.written - self.capacity + 1 - first)
        return first + lost, rows[lost:]

    def close(self) -> None:
        """Close the memory; the creator also removes it."""
        del self._header, self._rows
        self._memory.close()
        if self._owner:
            self._memory.unlink()


def parent_has_ended() -> bool:
    """Whether the process that spawned this one is gone."""
    parent = multiprocessing.parent_process()
    return parent is not None and not parent.is_alive()


def put_json(ring: "Ring", message: Json) -> None:
    """Append an event or a command. Raises ValueError if it is longer than a row."""
    text = _encode(message).encode()
    if len(text) >= ring.row_bytes:
        raise ValueError(
            f"{message.get('kind', message.get('type'))!r} has {len(text)} bytes, expected less"
            f" than {ring.row_bytes}"
        )
    ring.put(np.frombuffer(text + b"\0", np.uint8))


def read_json(rows: np.ndarray) -> Iterator[Json]:
    """Yield the events or commands in rows that `Ring.read` returned."""
    for row in rows:
        # `put_json` ends the text with a zero byte. Bytes of an earlier row may follow.
        text, _, _ = row.tobytes().partition(b"\0")
        yield json.loads(text)
