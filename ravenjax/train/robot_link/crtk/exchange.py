"""Between the realtime loop and the process that speaks CRTK: rows of the robot one way, commands
the other.

Both are rings in shared memory, so that neither ever waits for the other. A row is that of a
`Frame`, the wall clock at its tick, and the number of the last command that the loop had taken
before it.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ravenjax.train.protocol.frame import Frame, FrameLayout
from ravenjax.train.realtime.ring import COMMAND_BYTES, Ring, put_json, read_json

_TAIL = struct.Struct("<qqq")  # wall clock ns, monotonic ns, number of the last command
_KEPT_ROWS, _KEPT_COMMANDS = 64, 1024
_MOST_COMMANDS = 16


class RobotRow(NamedTuple):
    """One tick of the robot."""

    frame: Frame
    stamp_ns: int  # since 1970
    clock_ns: int  # monotonic
    last_command: int  # number of the last command that the loop took before
    number: int = 0  # of rows, from 0


class LoopEnd:
    """The realtime loop's end: it owns both rings."""

    def __init__(self, layout: FrameLayout) -> None:
        self._bytes = np.zeros(4 * layout.size + _TAIL.size, np.uint8)
        self._tail = 4 * layout.size
        self.rows = Ring.create(_KEPT_ROWS, self._bytes.size)
        self.commands = Ring.create(_KEPT_COMMANDS, COMMAND_BYTES)
        self._next = 0
        self.taken = 0

    def poll(self) -> list[dict[str, Any]]:
        """Commands that have arrived, without their numbers."""
        if self.commands.written == self._next:
            return []
        first, rows = self.commands.read(self._next, _MOST_COMMANDS)
        self._next = first + len(rows)
        commands = list(read_json(rows))
        for command in commands:
            self.taken = command.pop("command")
        return commands

    def tell(self, row: np.ndarray) -> None:
        """A tick's row, float32."""
        self._bytes[: self._tail] = row.view(np.uint8)
        _TAIL.pack_into(
            self._bytes.data, self._tail, time.time_ns(), time.monotonic_ns(), self.taken
        )
        self.rows.put(self._bytes)

    def close(self) -> None:
        """Remove both."""
        self.rows.close()
        self.commands.close()


class BridgeEnd:
    """The other process's end."""

    def __init__(self, rows: str, commands: str, layout: FrameLayout) -> None:
        self._rows, self._commands = Ring.attach(rows), Ring.attach(commands)
        self._frame = Frame(layout)
        self._tail = 4 * layout.size
        self.sent = 0

    def newest(self) -> RobotRow | None:
        """The last row; None before the first. Its frame is the same object each time."""
        written = self._rows.written
        first, rows = self._rows.read(written - 1)
        if not len(rows):
            return None
        content = rows[-1]
        self._frame.row[:] = content[: self._tail].view(np.float32)
        self._frame.settle()
        stamp, clock, last = _TAIL.unpack_from(content.data, self._tail)
        return RobotRow(self._frame, stamp, clock, last, first + len(rows) - 1)

    def send(self, command: Mapping[str, Any]) -> int:
        """Put a command into the ring; its number."""
        self.sent += 1
        put_json(self._commands, {**command, "command": self.sent})
        return self.sent

    def close(self) -> None:
        """Let go of both."""
        self._rows.close()
        self._commands.close()
