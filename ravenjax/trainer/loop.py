"""The realtime loop: one thread, one tick a millisecond, nothing that it ever waits for but the clock."""

from __future__ import annotations

import json
import socket
from collections.abc import Callable
from typing import Any, Protocol

import numpy as np

from ravenjax.trainer import clock
from ravenjax.trainer.clock import Clock, Timing
from ravenjax.trainer.frame import Frame
from ravenjax.trainer.ring import Ring, put_event
from ravenjax.trainer.session import Session

MOST_COMMANDS = 16
"""Commands taken in a tick; what is more waits for the next."""
LONGEST_COMMAND = 4096
AFTER_END_MS = 200
"""Ticks that go on after the end, so that everyone sees it."""


class Console(Protocol):
    """A console beside the page: polled for commands, told what the robot does."""

    def poll(self) -> list[dict[str, Any]]: ...
    def tell(self, frame: Frame) -> None: ...


class Inbox:
    """Commands that arrive as JSON datagrams on a socket; what is no command is counted."""

    def __init__(self, channel: socket.socket) -> None:
        channel.setblocking(False)
        self._channel, self.refused = channel, 0

    def poll(self) -> list[dict[str, Any]]:
        """What has arrived."""
        found = []
        for _ in range(MOST_COMMANDS):
            try:
                data = self._channel.recv(LONGEST_COMMAND)
            except (BlockingIOError, ConnectionError):
                break
            if not data:
                break
            try:
                command = json.loads(data)
            except ValueError:
                command = None
            if isinstance(command, dict):
                found.append(command)
            else:
                self.refused += 1
        return found

    def tell(self, frame: Frame) -> None:
        """Nothing: the page reads the ring."""


def run(
    session: Session,
    frames: Ring,
    events: Ring,
    consoles: list[Console],
    stopped: Callable[[], bool] = lambda: False,
    timing: Timing | None = None,
) -> Timing:
    """Run `session` in real time until it is over, or `stopped` says so."""
    paced = Clock(timing)
    layout, frame = session.layout, session.frame
    reported = left = 0
    with clock.no_collection():
        while left < AFTER_END_MS:
            paced.wait()
            commands = [command for console in consoles for command in console.poll()]
            if not session.over and stopped():
                commands.append({"type": "instructor", "do": "end"})
            told = session.tick(commands)
            frame["compute_us"], frame["lateness_us"] = paced.compute_us, paced.lateness_us
            frame["late_ticks"] = paced.timing.late
            frames.next_row().view(np.float32)[: layout.size] = frame.row
            frames.publish()
            if paced.timing.late > reported and session.ticks % 100 == 0:
                reported = paced.timing.late
                told.append({"tick": session.ticks, "kind": "overrun", "late_ticks": reported})
            for event in told:
                put_event(events, event)
            for console in consoles:
                console.tell(frame)
            left += session.over
            paced.done()
    return paced.timing
