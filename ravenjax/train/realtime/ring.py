"""Shared memory between processes of a session, one of which writes while others read; nobody
waits.

The realtime process writes frames and events for page and recorder, the page writes commands for
it: to look there costs less than a system call, which matters a thousand times a second. A writer
never looks at readers. A reader that is too slow finds out: rows that were overwritten are told,
not invented.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from multiprocessing import shared_memory
from typing import Any

import numpy as np

_HEADER = 64  # bytes: rows written so far, rows, bytes of a row


class Ring:
    """Rows of one NumPy type in shared memory, the last `capacity` of them."""

    def __init__(self, memory: shared_memory.SharedMemory, owner: bool) -> None:
        self._memory, self._owner = memory, owner
        self._header = np.ndarray((3,), np.int64, memory.buf)
        self.capacity, self.row_bytes = int(self._header[1]), int(self._header[2])
        self._rows = np.ndarray((self.capacity, self.row_bytes), np.uint8, memory.buf, _HEADER)
        self._written = int(self._header[0])  # by this side, if it writes

    @staticmethod
    def create(capacity: int, row_bytes: int) -> Ring:
        """A new ring; its `name` lets other processes attach."""
        size = _HEADER + capacity * row_bytes
        memory = shared_memory.SharedMemory(create=True, size=size)
        np.ndarray((size,), np.uint8, memory.buf)[:] = (
            0  # every page is there before the first tick needs it
        )
        np.ndarray((3,), np.int64, memory.buf)[:] = 0, capacity, row_bytes
        return Ring(memory, owner=True)

    @staticmethod
    def attach(name: str) -> Ring:
        """The ring that this process or the one that spawned it created. It stays the creator's
        to remove.
        """
        return Ring(shared_memory.SharedMemory(name=name), owner=False)

    @property
    def name(self) -> str:
        """What `attach` takes."""
        return self._memory.name

    @property
    def written(self) -> int:
        """Rows so far."""
        return int(self._header[0])

    def put(self, row: np.ndarray) -> None:
        """Append a row, uint8 [row_bytes] or less; what it leaves of the row stays as it was."""
        self._rows[self._written % self.capacity, : row.size] = row
        self._written += 1
        self._header[0] = self._written

    def read(self, first: int, limit: int | None = None) -> tuple[int, np.ndarray]:
        """Rows from number `first` on: (number of the first returned, copies, uint8 [n,
        row_bytes]).

        The first returned is later than asked for where rows were overwritten already.
        """
        end = self.written
        first = max(first, end - self.capacity + 1, 0)
        last = end if limit is None else min(end, first + limit)
        rows = self._rows[np.arange(first, last) % self.capacity].copy()
        lost = max(
            0, self.written - self.capacity + 1 - first
        )  # overwritten while they were copied
        return first + lost, rows[lost:]

    def close(self) -> None:
        """Let go of the memory; the creator removes it."""
        del self._header, self._rows
        self._memory.close()
        if self._owner:
            self._memory.unlink()


EVENT_BYTES = 2048
"""Room of one event as JSON."""
COMMAND_BYTES = 4096
"""Room of one command to a session."""
_encode = json.JSONEncoder(separators=(",", ":")).encode


def put_json(ring: Ring, message: dict[str, Any]) -> None:
    """Append an event or a command; ValueError where it is longer than a row."""
    text = _encode(message).encode()
    if len(text) >= ring.row_bytes:
        raise ValueError(
            f"{message.get('kind', message.get('type'))!r} has {len(text)} bytes, expected less"
            f" than {ring.row_bytes}"
        )
    ring.put(np.frombuffer(text + b"\0", np.uint8))


def read_json(rows: np.ndarray) -> Iterator[dict[str, Any]]:
    """The events or commands in rows that `Ring.read` gave."""
    for row in rows:
        yield json.loads(row.tobytes().split(b"\0", 1)[0])
