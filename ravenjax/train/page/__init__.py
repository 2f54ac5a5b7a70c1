"""The page of a training session: reads the rings, serves a browser, passes on what that says; in a
process of its own.

It never makes the realtime process wait: commands go into a ring of their own, which that looks at
once a tick.
"""

from __future__ import annotations

import contextlib
import dataclasses
import ipaddress
from multiprocessing.connection import Connection
from typing import Any

from ravenjax.errors import UserError
from ravenjax.train.robot import ArmName


@dataclasses.dataclass(frozen=True)
class PageOptions:
    """The options that the page's process receives, pickled."""

    frames: str  # name of the ring of frames
    events: str  # name of the ring of events
    commands: str  # name of the ring of commands, which the page writes
    arms: tuple[ArmName, ...]
    # as in session.json: name, hazards, task, blinded; cue_threshold_mm besides
    header: dict[str, Any]
    folder: str | None = None  # where debrief.html appears once the session is over
    host: str = "127.0.0.1"
    port: int = 0  # 0: a free one
    # what every request must carry; needed where `host` is not a loopback address
    token: str | None = None
    # what an instructor's window must carry; None: nobody instructs
    instructor_token: str | None = None

    def __post_init__(self) -> None:
        if not self.token and not loopback(self.host):
            raise UserError(
                f"host is {self.host!r}, which others can reach, and there is no token: "
                "give one that every visitor must carry, or bind 127.0.0.1"
            )
        if self.token and self.token == self.instructor_token:
            raise UserError(
                "token and instructor_token are the same: whoever drives could instruct; give two"
                " that differ"
            )


def loopback(host: str) -> bool:
    """Whether only this machine can reach a server on `host`."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def run_when_told(told: Connection) -> None:
    """Import, then serve the page for the `PageOptions` that come through `told`, until the process
    is terminated or the session's is gone; the port that it took is sent there. The entry point of
    a spawned process.
    """
    # viser and MuJoCo take seconds, and only the page's process needs them.
    from ravenjax.train.page import process

    # EOFError: the session ended before it began.
    with contextlib.suppress(EOFError):
        process.run(told.recv(), told)
