"""The page of a training session: reads the rings, serves a browser, passes on what that says; in a
process of its own.

It never makes the realtime process wait: commands go into a ring of their own, which that looks at
once a tick.
"""

from __future__ import annotations

import contextlib
import dataclasses
from multiprocessing.connection import Connection

from ravenjax.train.page.options import PageOptions

__all__ = ["PageOptions", "run", "run_when_told"]


def run(options: PageOptions) -> None:
    """Serve the page until the process is terminated or the session's is gone. The entry point of a
    spawned process.

    Sends its port through `options.port_taken` once it listens.
    """
    from ravenjax.train.page import (
        process,
    )  # viser and MuJoCo: seconds, wanted in the page's process alone

    process.run(options)


def run_when_told(told: Connection) -> None:
    """Import, then serve the page for the `PageOptions` that come through `told`, where the port
    is sent, too.
    """
    from ravenjax.train.page import process

    with contextlib.suppress(EOFError):  # the session ended before it began
        process.run(dataclasses.replace(told.recv(), port_taken=told))
