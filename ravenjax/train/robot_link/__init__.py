"""Connects sessions to robots and consoles over a network."""

import contextlib
import socket
from collections.abc import Iterator

from ravenjax import resources
from ravenjax.errors import UserError

WORDS = resources.read_tables(__file__, "link.toml")


@contextlib.contextmanager
def refuse_errors(failure: str, advice: str, *opened: socket.socket) -> Iterator[None]:
    """Turn an error of the network into a UserError, and close the sockets.
    failure: what cannot be done. advice: what to do.
    """
    try:
        yield
    except (OSError, OverflowError) as error:
        for each in opened:
            each.close()
        raise UserError(f"{failure} ({error}): {advice}") from None
