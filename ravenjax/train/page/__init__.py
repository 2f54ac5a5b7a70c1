"""The page of a training session: reads the rings, serves a browser, and forwards its commands.

It runs in a process of its own and never makes the realtime process wait. Commands go into a
separate ring, which the realtime process reads once a tick.
"""

import contextlib
import dataclasses
import ipaddress
from multiprocessing.connection import Connection

from ravenjax.errors import UserError
from ravenjax.train.protocol import Json
from ravenjax.train.robot import Arms


@dataclasses.dataclass(frozen=True)
class PageOptions:
    """The options that the page's process receives, pickled."""

    frames: str  # name of the ring of frames
    events: str  # name of the ring of events
    # Name of the ring of commands, which the page writes.
    commands: str
    arms: Arms
    # As in session.json: name, hazards, task, blinded; also cue_threshold_mm.
    header: Json
    folder: str | None = None  # where debrief.html appears once the session is over
    host: str = "127.0.0.1"
    port: int = 0  # 0: a free one
    # Required in every request; needed if `host` is not a loopback address.
    token: str | None = None
    # Required of an instructor's window; None: nobody can instruct.
    instructor_token: str | None = None

    def __post_init__(self) -> None:
        if not self.token and not is_loopback(self.host):
            raise UserError(
                f"host is {self.host!r}, which other machines can reach, and there is no token:"
                " give --token, or host 127.0.0.1"
            )
        if self.token and self.token == self.instructor_token:
            raise UserError(
                "token and instructor_token are the same, so an operator could instruct: give two"
                " that differ"
            )


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach a server on `host`."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def run_when_told(session: Connection) -> None:
    """Import the page, then serve it with the `PageOptions` that `session` sends.

    The answer is its port. It serves until it is terminated or the session's process ends.
    """
    # viser and MuJoCo take seconds to import, and only the page's process needs them.
    from ravenjax.train.page import process

    # EOFError: the session ended before the page began.
    with contextlib.suppress(EOFError):
        process.serve_page(session.recv(), session)
