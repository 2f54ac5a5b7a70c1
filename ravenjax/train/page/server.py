"""Serves everything on one port: viser's server, with the session's pages and websocket in front of
it.

HTTP requests get viser's client with the page's own lines in it, static files, and the debrief. The
instructor also gets the sessions in the same folder. Viser binds its websocket server itself,
without checking its visitors. It is started with that one function wrapped. So `auth` checks first,
/session is handled here, and the remaining requests reach viser. There is one thread and one event
loop.
"""

import asyncio
import contextlib
import contextvars
import gzip
import io
import json
from collections.abc import Awaitable, Callable
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import viser
import viser.infra
from viser import _messages
from websockets.asyncio import server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ravenjax.train.page import PageOptions
from ravenjax.train.page.auth import Auth, query_parameters, same_secret
from ravenjax.train.recording import folders

SESSION = "/session"
SCENE = "/scene/"
LARGEST_BYTES = 65536
"""A longer message closes the connection. The reader of a shorter one judges its length."""
STATIC = Path(__file__).resolve().parent / "static"
DEBRIEF, TABLE = "debrief.html", "hazards.csv"
_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}
_EARLY = '<script src="/static/early.js"></script>'
_LOOK = (
    '<link rel="stylesheet" href="/static/page.css">'
    '<script type="module" src="/static/scene.js"></script>'
)
_LATE = (
    f'{_LOOK}<link rel="stylesheet" href="/static/instructor.css"><script type="module"'
    ' src="/static/page.js"></script>'
)
_WITHOUT_SCENE = (
    f'<!doctype html><html lang="en"><head>{_EARLY}<meta charset="utf-8" />'
    '<link rel="icon" href="data:," />'
    '<meta name="viewport" content="width=device-width, initial-scale=1" />'
    f"<title>ravenjax</title>{_LATE}</head><body>PANEL</body></html>"
)

_POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:;"
    " style-src 'self' 'unsafe-inline'; worker-src blob: data:; connect-src 'self' ws://{host}"
    " wss://{host} data: blob:; frame-ancestors 'self'; base-uri 'none'"
)
"""Under this policy no request of the page leaves the server, whatever a scene requests."""
window: contextvars.ContextVar[str] = contextvars.ContextVar("window", default="")
"""The browser window to which the viser client of this task belongs; see `early.js`."""

Handler = Callable[[ServerConnection], Awaitable[None]]


class PageServer:
    """A running viser server behind checks, with the files of one session.

    A request for any other file gets 404. A request that the checks refuse gets 403.
    """

    def __init__(self, options: PageOptions, session: Handler) -> None:
        """session: handles each websocket of /session."""
        self._auth, self._session = Auth(options.host, options.token), session
        self._instructor_token = options.instructor_token
        self._folder = Path(options.folder) if options.folder else None
        self._files = {
            f"/static/{path.name}": (_TYPES[path.suffix], gzip.compress(path.read_bytes(), 6))
            for path in STATIC.iterdir()
            if path.suffix in _TYPES
        }
        panel = (STATIC / "panel.html").read_text(encoding="utf-8")
        client = Path(viser.__file__).parent / "client" / "build" / "index.html"
        scene = client.read_text(encoding="utf-8")
        pages = {
            "panel": _WITHOUT_SCENE.replace("PANEL", panel),
            "scene": _with_panel(scene, _LATE, panel),
            "inset": _with_panel(scene, _LOOK, ""),
        }
        self._pages = {name: gzip.compress(text.encode(), 6) for name, text in pages.items()}
        # Number of sockets that show the scene.
        self.watching = 0
        original = websocket_server.serve
        websocket_server.serve = self._serving(original)  # pyright: ignore
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                self.viser = viser.ViserServer(host=options.host, port=options.port, verbose=False)
        finally:
            websocket_server.serve = original
        self._auth.port = self.port
        # Remove viser's share request: a visitor could make viser open a tunnel to an outside
        # server. Nothing leaves this machine.
        self.viser._websock_server.unregister_handler(_messages.ShareUrlRequest)

    @property
    def port(self) -> int:
        return self.viser.get_port()

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """The event loop of all handlers, which runs in a separate thread."""
        return self.viser.get_event_loop()

    def _serving(self, original: Callable[..., Any]) -> Callable[..., Any]:
        """Return `websockets.serve` with the checks and the session's own socket in front."""

        def serve(handler: Handler, host: str, port: int, **settings: Any) -> Any:
            async def handle(connection: ServerConnection) -> None:
                path = urlsplit(connection.request.path if connection.request else "").path
                if path == SESSION:
                    await self._session(connection)
                    return
                window.set(path.removeprefix(SCENE))
                self.watching += 1
                try:
                    await handler(connection)
                finally:
                    self.watching -= 1

            def process(connection: ServerConnection, request: Request) -> Response | None:
                # The first request may come before the constructor is done.
                if self._auth.port == 0 and connection.local_address:
                    self._auth.port = connection.local_address[1]
                connection.protocol.max_message_size = LARGEST_BYTES
                return self._answer(request)

            return original(handle, host, port, **{**settings, "process_request": process})

        return serve

    def _answer(self, request: Request) -> Response | None:
        """Return the response; None lets a websocket through."""
        reason = self._auth.refusal(request)
        if reason is not None:
            return _refusal(HTTPStatus.FORBIDDEN, reason)
        if (request.headers.get("Upgrade") or "").lower() == "websocket":
            return None
        path, parameters = urlsplit(request.path).path, query_parameters(request.path)
        debrief = self._folder / DEBRIEF if self._folder else None
        has_debrief = debrief is not None and debrief.is_file()
        if path == "/debrief.json":
            has_table = self._folder is not None and (self._folder / TABLE).is_file()
            ready = json.dumps({"ready": has_debrief, "table": has_table}).encode()
            return _response(HTTPStatus.OK, "application/json", ready)
        if path == f"/{DEBRIEF}" and debrief is not None and has_debrief:
            return _response(HTTPStatus.OK, _TYPES[".html"], debrief.read_bytes())
        if path.startswith("/sessions"):
            return self._earlier_session(path, parameters.get("instructor_token", ""))
        extra = {"Content-Encoding": "gzip"}
        if cookie := self._auth.cookie(request):
            extra["Set-Cookie"] = cookie
        if path == "/":
            with_scene = "panel" if parameters.get("scene") == "off" else "scene"
            body = self._pages["inset" if "inset" in parameters else with_scene]
            extra["Content-Security-Policy"] = _POLICY.format(host=request.headers["Host"])
            return _response(HTTPStatus.OK, _TYPES[".html"], body, extra)
        if path in self._files:
            return _response(HTTPStatus.OK, *self._files[path], extra)
        return _refusal(HTTPStatus.NOT_FOUND, "no such page")

    def _earlier_session(self, path: str, token: str) -> Response:
        if self._folder is None or not same_secret(token, self._instructor_token):
            return _refusal(HTTPStatus.FORBIDDEN, "the list of sessions is the instructor's")
        sessions = {
            session.path.name: session for session in folders.sessions_beside(self._folder.parent)
        }
        if path == "/sessions":
            # jinja takes a while to import.
            from ravenjax.document import html

            template = html.template_environment("ravenjax.train").get_template("sessions.html.j2")
            text = template.render(
                sessions=[*reversed(sessions.values())],
                has_debrief={name: (s.path / DEBRIEF).is_file() for name, s in sessions.items()},
                folder=str(self._folder.parent),
                running=self._folder.name,
                token=token,
            )
            return _response(HTTPStatus.OK, _TYPES[".html"], text.encode())
        name, _, file = unquote(path).removeprefix("/sessions/").rpartition("/")
        if name in sessions and file == DEBRIEF and (sessions[name].path / DEBRIEF).is_file():
            body = (sessions[name].path / DEBRIEF).read_bytes()
            return _response(HTTPStatus.OK, _TYPES[".html"], body)
        return _refusal(HTTPStatus.NOT_FOUND, "no such session")


def _refusal(status: HTTPStatus, text: str) -> Response:
    return _response(status, "text/plain", f"{text}\n".encode())


def _response(
    status: HTTPStatus, kind: str, body: bytes, extra: dict[str, str] | None = None
) -> Response:
    headers = {
        "Content-Type": kind,
        "Content-Length": str(len(body)),
        "Cache-Control": "no-store",
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "SAMEORIGIN",
        # The address may hold the token, so it must not appear in a referrer.
        "Referrer-Policy": "no-referrer",
    }
    return Response(status.value, status.phrase, Headers({**headers, **(extra or {})}), body)


def _with_panel(client: str, late: str, panel: str) -> str:
    """Return the page of viser's client, which is self-contained, with a panel over it."""
    text = client.replace("<head>", f"<head>{_EARLY}", 1)
    text = text.replace("<title>Viser</title>", "<title>ravenjax</title>", 1)
    head, _, rest = text.rpartition("</head>")
    root = '<div id="root"></div>'
    text = f"{head}{late}</head>{rest}".replace(root, f"{root}{panel}", 1)
    for part in (_EARLY, late, panel):
        if part not in text:
            raise RuntimeError(
                f"viser {viser.__version__}: its client's page has no place for {part[:60]!r}"
            )
    return text
