"""The page of a training session: reads the rings, serves a browser, passes on what that says; in a process of its own.

It never makes the realtime process wait: commands go into a ring of their own, which that looks at once a tick.
"""

from __future__ import annotations

from ravenjax.trainer.page.options import PageOptions

__all__ = ["PageOptions", "run"]


def run(options: PageOptions) -> None:
    """Serve the page until the process is terminated or the session's is gone. The entry point of a spawned process.

    Sends its port through `options.port_taken` once it listens.
    """
    from ravenjax.trainer.page import process  # viser and MuJoCo: seconds, wanted in the page's process alone

    process.run(options)
