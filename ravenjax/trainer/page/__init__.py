"""The page of a training session: reads the rings, serves a browser, passes on what that says; in a process of its own.

It never makes the realtime process wait: commands go out as datagrams that are dropped, and counted, where nobody
takes them.
"""

from __future__ import annotations

from ravenjax.trainer.page.options import Options

__all__ = ["Options", "run"]


def run(options: Options) -> None:
    """Serve the page until the command socket is closed at the other end. The entry point of a spawned process.

    Sends {"type": "page", "port": N} through the command socket once it listens.
    """
    from ravenjax.trainer.page import process  # viser and MuJoCo: seconds, wanted in the page's process alone

    process.run(options)
