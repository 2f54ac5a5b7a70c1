"""One port for everything: viser's server, with the session's own pages and websocket in front of
it.

Viser binds its websocket server itself, without a look at who asks. It is started with that one
function wrapped, so that the door is asked first, /session is ours, and only what is left reaches
viser; one thread and one event loop.
"""

from __future__ import annotations

import asyncio
import contextlib
import contextvars
import io
from collections.abc import Awaitable, Callable, Iterator
from typing import Any
from urllib.parse import urlsplit

import viser
import viser.infra
import websockets.asyncio.server
from viser import _messages
from websockets.asyncio.server import ServerConnection
from websockets.http11 import Request, Response

from ravenjax.train.page.door import Door
from ravenjax.train.page.site import PageSite

SESSION = "/session"
SCENE = "/scene/"
LARGEST_BYTES = 65536
"""A message longer than that closes the connection; shorter ones are for their reader to judge."""

window: contextvars.ContextVar[str] = contextvars.ContextVar("window", default="")
"""Which window of a browser the viser client of this task belongs to; see `early.js`."""

Handler = Callable[[ServerConnection], Awaitable[None]]


class Server:
    """A running viser server behind the door."""

    def __init__(self, host: str, port: int, door: Door, site: PageSite, session: Handler) -> None:
        """session: handles each websocket of /session."""
        self.watching = 0  # sockets that look at the scene
        with (
            _wrapped(door, site, session, self._watched),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            self.viser = viser.ViserServer(host=host, port=port, verbose=False)
        door.port = self.viser.get_port()
        # A visitor could make viser open a tunnel to a server elsewhere; nothing leaves this
        # machine.
        self.viser._websock_server.unregister_handler(_messages.ShareUrlRequest)

    def _watched(self, change: int) -> None:
        self.watching += change

    @property
    def port(self) -> int:
        """That it listens on."""
        return self.viser.get_port()

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """In which every handler runs, in a thread of its own."""
        return self.viser.get_event_loop()


@contextlib.contextmanager
def _wrapped(
    door: Door, site: PageSite, session: Handler, watched: Callable[[int], None]
) -> Iterator[None]:
    original = websockets.asyncio.server.serve

    def serve(handler: Handler, host: str, port: int, **settings: Any) -> Any:
        async def handle(connection: ServerConnection) -> None:
            path = urlsplit(connection.request.path if connection.request else "").path
            if path == SESSION:
                await session(connection)
            else:
                window.set(path.removeprefix(SCENE))
                watched(1)
                try:
                    await handler(connection)
                finally:
                    watched(-1)

        def process(connection: ServerConnection, request: Request) -> Response | None:
            if door.port == 0 and connection.local_address:
                door.port = connection.local_address[
                    1
                ]  # the first to come may come before the constructor is done
            connection.protocol.max_message_size = LARGEST_BYTES
            return site.answer(request)

        return original(handle, host, port, **{**settings, "process_request": process})

    websockets.asyncio.server.serve = serve  # pyright: ignore[reportAttributeAccessIssue, reportPrivateImportUsage]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = original
