"""What the page's process is told when it is spawned."""

from __future__ import annotations

import dataclasses
import ipaddress
from multiprocessing.connection import Connection
from typing import Any

from ravenjax.errors import UserError
from ravenjax.robots.raven2.arms import ArmName


@dataclasses.dataclass(frozen=True)
class PageOptions:
    """Picklable, so that a spawned process gets it whole."""

    frames: str  # name of the ring of frames
    events: str  # name of the ring of events
    commands: str  # name of the ring of commands, which the page writes
    port_taken: Connection | None  # the page says here which port it took, once it listens
    arms: tuple[ArmName, ...]
    header: dict[
        str, Any
    ]  # as in session.json: name, hazards, task, blinded; cue_threshold_mm besides
    folder: str | None = None  # where debrief.html appears once the session is over
    host: str = "127.0.0.1"
    port: int = 0  # 0: a free one
    token: str | None = (
        None  # every request must carry it; needed where `host` is not a loopback address
    )
    instructor_token: str | None = (
        None  # what an instructor's window must carry; None: nobody instructs
    )
    fps: float = 60.0  # frames a second, 30 at least

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
        if not 30.0 <= self.fps <= 240.0:
            raise UserError(f"fps is {self.fps!r}, expected 30 to 240")


def loopback(host: str) -> bool:
    """Whether only this machine can reach a server on `host`."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False
