"""One port for everything: viser's server, with the session's own pages and websocket in front of
it.

Viser binds its websocket server itself, without a look at who asks. It is started with that one
function wrapped, so that `auth` is asked first, /session is ours, and only what is left reaches
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

from ravenjax.train.page.auth import Auth
from ravenjax.train.page.site import PageSite

SESSION = "/session"
SCENE = "/scene/"
LARGEST_BYTES = 65536
"""A message longer than that closes the connection; shorter ones are for their reader to judge."""

window: contextvars.ContextVar[str] = contextvars.ContextVar("window", default="")
"""Which window of a browser the viser client of this task belongs to; see `early.js`."""

Handler = Callable[[ServerConnection], Awaitable[None]]


class Server:
    """A running viser server behind its checks."""

    def __init__(self, host: str, port: int, auth: Auth, site: PageSite, session: Handler) -> None:
        """session: handles each websocket of /session."""
        # Sockets that look at the scene.
        self.watching = 0
        with (
            _wrapped(auth, site, session, self._count_watchers),
            contextlib.redirect_stdout(io.StringIO()),
        ):
            self.viser = viser.ViserServer(host=host, port=port, verbose=False)
        auth.port = self.viser.get_port()
        # A visitor could make viser open a tunnel to a server elsewhere; nothing leaves this
        # machine.
        self.viser._websock_server.unregister_handler(_messages.ShareUrlRequest)

    def _count_watchers(self, change: int) -> None:
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
    auth: Auth, site: PageSite, session: Handler, watched: Callable[[int], None]
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
            # The first request may come before the constructor is done.
            if auth.port == 0 and connection.local_address:
                auth.port = connection.local_address[1]
            connection.protocol.max_message_size = LARGEST_BYTES
            return site.answer(request)

        return original(handle, host, port, **{**settings, "process_request": process})

    websockets.asyncio.server.serve = serve  # pyright: ignore[reportAttributeAccessIssue, reportPrivateImportUsage]
    try:
        yield
    finally:
        websockets.asyncio.server.serve = original
