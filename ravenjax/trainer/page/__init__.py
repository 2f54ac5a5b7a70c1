"""The page of a training session: reads the rings, serves a browser, passes on what that says; in a process of its own.

It never makes the realtime process wait: commands go into a ring of their own, which that looks at once a tick.
"""

from __future__ import annotations

from ravenjax.trainer.page.options import Options

__all__ = ["Options", "run"]


def run(options: Options) -> None:
    """Serve the page until the session's end of the channel is closed. The entry point of a spawned process.

    Sends {"type": "page", "port": N} through the channel once it listens.
    """
    from ravenjax.trainer.page import process  # viser and MuJoCo: seconds, wanted in the page's process alone

    process.run(options)
