"""Runs the process that serves the training page: reads frames and events of the session from
shared memory, sends these to the browser windows, and draws the scene there.
"""

import asyncio
import contextlib
import dataclasses
import gzip
import io
import json
import logging
import signal
import socket
import threading
import time
from collections.abc import Awaitable, Callable
from http import HTTPStatus
from http.cookies import CookieError, SimpleCookie
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import numpy as np
import viser
import viser.infra
from viser import _messages
from websockets.asyncio import server as websocket_server
from websockets.asyncio.server import ServerConnection
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ravenjax.store.ring import Ring, parent_has_ended, read_json
from ravenjax.train.page import STATIC, PageOptions, query_parameters, same_secret
from ravenjax.train.page.hub import Hub
from ravenjax.train.page.scene import Scene, Windows, describe_field, window
from ravenjax.train.protocol import Frame, FrameLayout, closing_point, with_tips
from ravenjax.train.robot import ARMS, tip_pose

# Reads the model of the operating field, which takes 0.2 s, while the session prepares its robot.
describe_field(ARMS)
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


@dataclasses.dataclass(frozen=True)
class Auth:
    """Checks the requests of one server: host, origin and token."""

    host: str
    token: str | None
    port: int

    def refusal(self, request: Request) -> str | None:
        """Return why this request is refused; None if it is allowed."""
        try:
            # Raises ValueError if the address is invalid.
            urlsplit(request.path)
            return self._refusal(request)
        except ValueError as error:
            return f"the address or the origin is invalid ({error})"

    def _refusal(self, request: Request) -> str | None:
        # Returns why a request is refused; None if it is this server's page with the right token.
        def header(name: str) -> str | None:
            # No browser sends a header twice, so a repeated header is invalid.
            values = request.headers.get_all(name)
            return None if not values else values[0] if len(values) == 1 else ""

        host, origin = header("Host"), header("Origin")
        name, _, port = (host or "").lower().rpartition(":")
        # Another site's name may lead to this machine (DNS rebinding). A token prevents requests of
        # its pages, so with a token, any name of the host is allowed.
        is_known_name = name in (*LOOPBACK, self.host) and port == str(self.port)
        if not host or not (self.token is not None or is_known_name):
            return f"the request is for host {host!r}, which is not this server"
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return f"origin {origin!r} is not this server's page"
        # A websocket, which has the header Upgrade, was checked by its origin.
        if header("Upgrade") is None and header("Sec-Fetch-Site") == "cross-site":
            return "a page of another site sent the request"
        if self.token is None:
            return None
        tokens = [query_parameters(request.path).get("token", "")]
        # An invalid cookie contains no token.
        with contextlib.suppress(CookieError):
            cookie = SimpleCookie(header("Cookie") or "").get(self._cookie_name)
            tokens += [cookie.value] if cookie else []
        if not any(same_secret(token, self.token) for token in tokens):
            return (
                "the token is missing or wrong: open the address that was printed, with ?token=..."
            )
        return None

    def cookie(self, request: Request) -> str | None:
        """Return the cookie to set if the address has a token, for later requests; else None."""
        if self.token is None or not query_parameters(request.path).get("token"):
            return None
        return f"{self._cookie_name}={self.token}; HttpOnly; SameSite=Strict; Path=/"

    @property
    def _cookie_name(self) -> str:
        # All ports of a host share cookies, so the name contains the port.
        return f"ravenjax_{self.port}"


SESSION = "/session"
SCENE = "/scene/"
MAX_MESSAGE_BYTES = 65536
"""A longer message closes the connection. `Inbox` checks the length of other messages."""
DEBRIEF, TABLE = "debrief.html", "hazards.csv"
_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}
_FIRST_TAG = '<script src="/static/early.js"></script>'
_SCENE_TAGS = (
    '<link rel="stylesheet" href="/static/page.css">'
    '<script type="module" src="/static/scene.js"></script>'
)
_PANEL_TAGS = (
    f'{_SCENE_TAGS}<link rel="stylesheet" href="/static/instructor.css"><script type="module"'
    ' src="/static/page.js"></script>'
)
_WITHOUT_SCENE = (
    f'<!doctype html><html lang="en"><head>{_FIRST_TAG}<meta charset="utf-8" />'
    '<link rel="icon" href="data:," />'
    '<meta name="viewport" content="width=device-width, initial-scale=1" />'
    f"<title>ravenjax</title>{_PANEL_TAGS}</head><body>PANEL</body></html>"
)

_POLICY = (
    "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob: data:;"
    " style-src 'self' 'unsafe-inline'; worker-src blob: data:; connect-src 'self' ws://{host}"
    " wss://{host} data: blob:; frame-ancestors 'self'; base-uri 'none'"
)
"""With this policy, browsers send requests of the page to this server only."""
Handler = Callable[[ServerConnection], Awaitable[None]]


class PageConnection(ServerConnection):
    """A connection that refuses other methods than GET. The library hangs up without an answer."""

    _is_get = False

    def data_received(self, data: bytes) -> None:
        # The first bytes of a connection decide. There may be fewer than 4.
        self._is_get = self._is_get or b"GET ".startswith(data[:4])
        if self._is_get:
            super().data_received(data)
            return
        self.transport.write(_refusal(HTTPStatus.METHOD_NOT_ALLOWED, "").serialize())
        self.transport.close()


class PageServer:
    """A viser server that also serves the page and the files of one session. `Auth` checks each
    request. A refused request gets 403, a request for another file 404.
    """

    def __init__(self, options: PageOptions, listening: socket.socket, session: Handler):
        """listening: socket of the server. session: handles each websocket of /session."""
        port = listening.getsockname()[1]
        self._auth = Auth(options.host, options.token, port)
        self._listening, self._session = listening, session
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
            "scene": _with_panel(scene, _PANEL_TAGS, panel),
            "inset": _with_panel(scene, _SCENE_TAGS, ""),
        }
        self._pages = {name: gzip.compress(text.encode(), 6) for name, text in pages.items()}
        self.watching = 0  # Number of sockets that show the scene
        # viser has no option for a listening socket and other requests, so its server is wrapped.
        original = websocket_server.serve
        websocket_server.serve = self._serving(original)  # pyright: ignore
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                self.viser = viser.ViserServer(host=options.host, port=port, verbose=False)
        finally:
            websocket_server.serve = original
        # Remove viser's share request, by which a visitor could open a tunnel to another server.
        self.viser._websock_server.unregister_handler(_messages.ShareUrlRequest)

    @property
    def loop(self) -> asyncio.AbstractEventLoop:
        """The event loop of all handlers, which runs in a separate thread."""
        return self.viser.get_event_loop()

    def _serving(self, original: Callable[..., Any]) -> Callable[..., Any]:
        """Return `websockets.serve` with `Auth` and the websocket of /session added."""

        def serve(handler: Handler, *_, **settings):
            # viser calls this in place of `original`, the function of the library websockets. It
            # serves the scene with viser's handler, and the session's messages, at one port.
            async def handle(connection: ServerConnection) -> None:
                path = urlsplit(connection.request.path if connection.request else "").path
                if path == SESSION:
                    await self._session(connection)
                    return
                # Tells the scene to which browser window viser's new client belongs.
                window.set(path.removeprefix(SCENE))
                self.watching += 1
                try:
                    await handler(connection)
                finally:
                    self.watching -= 1

            settings |= {"process_request": self._answer, "sock": self._listening}
            settings |= {"create_connection": PageConnection, "max_size": MAX_MESSAGE_BYTES}
            return original(handle, **settings)

        return serve

    def _answer(self, _: ServerConnection, request: Request) -> Response | None:
        """Return the response; None lets a websocket through."""
        reason = self._auth.refusal(request)
        if reason is not None:
            return _refusal(HTTPStatus.FORBIDDEN, reason)
        if (request.headers.get("Upgrade") or "").lower() == "websocket":
            return None
        path, parameters = urlsplit(request.path).path, query_parameters(request.path)
        if path == "/debrief.json":
            files = {"ready": DEBRIEF, "table": TABLE}
            has = {name: _has_file(self._folder, file) for name, file in files.items()}
            return _response("application/json", json.dumps(has).encode())
        if path == f"/{DEBRIEF}":
            return _debrief(self._folder)
        if path.startswith("/sessions"):
            return self._earlier_session(path, parameters.get("instructor_token", ""))
        extra = {"Content-Encoding": "gzip"}
        if cookie := self._auth.cookie(request):
            extra["Set-Cookie"] = cookie
        if path == "/":
            page = "panel" if parameters.get("scene") == "off" else "scene"
            page = "inset" if "inset" in parameters else page
            extra["Content-Security-Policy"] = _POLICY.format(host=request.headers["Host"])
            return _response(_TYPES[".html"], self._pages[page], extra)
        if path in self._files:
            return _response(*self._files[path], extra)
        return _refusal(HTTPStatus.NOT_FOUND, "no such page")

    def _earlier_session(self, path: str, token: str) -> Response:
        # Returns the list of earlier sessions, or the debrief of one of them.
        if self._folder is None or not same_secret(token, self._instructor_token):
            return _refusal(HTTPStatus.FORBIDDEN, "the list of sessions is the instructor's")
        # These take a while to import.
        from ravenjax.train.recording.reader import find_sessions

        sessions = find_sessions(self._folder.parent)
        if path == "/sessions":
            from ravenjax.document import html

            template = html.template_environment("ravenjax.train").get_template("sessions.html.j2")
            text = template.render(
                sessions=[*reversed(sessions.values())],
                has_debrief={name: _has_file(s.path, DEBRIEF) for name, s in sessions.items()},
                folder=str(self._folder.parent),
                running=self._folder.name,
                token=token,
            )
            return _response(_TYPES[".html"], text.encode())
        name, _, file = unquote(path).removeprefix("/sessions/").rpartition("/")
        return _debrief(sessions[name].path if name in sessions and file == DEBRIEF else None)


def _has_file(folder: Path | None, name: str) -> bool:
    return folder is not None and (folder / name).is_file()


def _debrief(folder: Path | None) -> Response:
    """Return the debrief in a session's folder; None: there is no such session."""
    if folder is None or not _has_file(folder, DEBRIEF):
        return _refusal(HTTPStatus.NOT_FOUND, "no such session, or no debrief yet")
    return _response(_TYPES[".html"], (folder / DEBRIEF).read_bytes())


def _refusal(status: HTTPStatus, text: str) -> Response:
    return _response("text/plain", f"{text}\n".encode(), status=status)


def _response(
    media_type: str,
    body: bytes,
    extra: dict[str, str] | None = None,
    status: HTTPStatus = HTTPStatus.OK,
) -> Response:
    headers = {
        "Content-Type": media_type,
        "Content-Length": str(len(body)),
        "Cache-Control": "no-store",
        "X-Content-Type-Options": "nosniff",
        "X-Frame-Options": "SAMEORIGIN",
        # The address may hold the token, so it must not appear in a referrer.
        "Referrer-Policy": "no-referrer",
        "Allow": "GET",
    } | (extra or {})
    return Response(status.value, status.phrase, Headers(headers), body)


def _with_panel(client: str, head_tags: str, panel: str) -> str:
    """Return the HTML page of viser's client with these tags in its head and a panel over it.
    Raises RuntimeError if the client of this version of viser has no place for a part.
    """
    text = client.replace("<head>", f"<head>{_FIRST_TAG}", 1)
    text = text.replace("<title>Viser</title>", "<title>ravenjax</title>", 1)
    head, _, rest = text.rpartition("</head>")
    root = '<div id="root"></div>'
    text = f"{head}{head_tags}</head>{rest}".replace(root, f"{root}{panel}", 1)
    for part in (_FIRST_TAG, head_tags, panel):
        if part not in text:
            raise RuntimeError(
                f"viser {viser.__version__} is not supported: its page has no {part[:60]!r}."
                " Install the version in requirements.lock"
            )
    return text


# Interval between frames after an input, whose effect is shown soon, and how long this lasts.
FAST_PERIOD_S, FAST_S = 0.004, 0.06
PERIOD_S = 1 / 60
"""Interval between frames at other times."""


def serve_page(options: PageOptions, listening: socket.socket, ready: Connection) -> None:
    """Serve the page at a listening socket. Send its port through `ready` once it is served."""
    # The session handles Ctrl-C, and ends this process after its own work.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    with contextlib.closing(Page(options, listening)) as page:
        ready.send(listening.getsockname()[1])
        ready.close()
        page.work()


class Page:
    """The page of one session."""

    _next_event = _next_frame = 0
    _fast_until = 0.0

    def __init__(self, options: PageOptions, listening: socket.socket):
        self._layout = FrameLayout.of(options.arms)
        ring_names = options.frames, options.events, options.commands
        self._frames, self._events, commands = self._rings = [*map(Ring.attach, ring_names)]
        self._changed = threading.Event()
        windows = Windows()
        field = describe_field(options.arms)
        self._hub = Hub(options, field, commands, windows.set_camera, self._speed_up)
        # Refused connections are not logged.
        logging.getLogger("websockets").setLevel(logging.CRITICAL)
        self._server = PageServer(options, listening, self._hub.serve)
        windows.watch(self._server.viser)
        header = options.header
        blinded = bool(header.get("blinded"))
        self._scene = Scene(self._server.viser, options.arms, header.get("task"), blinded)

    def work(self) -> None:
        # Sends frames and events to the windows, and draws the scene, until the session ends.
        last_frame = time.monotonic()
        while not parent_has_ended():
            now = time.monotonic()
            self._forward()
            # A wait may end up to a millisecond early.
            if now >= last_frame + PERIOD_S - 1e-3:
                last_frame = now
                self._draw()
            until_frame = max(0.0, last_frame + PERIOD_S - time.monotonic())
            self._changed.wait(FAST_PERIOD_S if now < self._fast_until else until_frame)
            self._changed.clear()

    def close(self) -> None:
        # viser prints a message when it stops.
        with contextlib.redirect_stdout(io.StringIO()):
            self._server.viser.stop()
        for ring in self._rings:
            ring.close()

    def _forward(self):
        # Forwards new events and the newest row of the session to the browsers.
        call_soon = self._server.loop.call_soon_threadsafe
        first, rows = self._events.read(self._next_event)
        if len(rows):
            self._next_event = first + len(rows)
            events = list(read_json(rows))
            for event in events:
                self._scene.follow(event)
            call_soon(self._hub.announce, events)
        _, rows = self._frames.read(self._next_frame)
        if len(rows):
            self._next_frame = self._frames.written
            if self._hub.clients:
                frames = rows.view(np.float32)
                row = with_tips(self._layout, frames[-1])
                call_soon(self._hub.show, row, self._extras(frames))

    def _extras(self, frames: np.ndarray) -> np.ndarray:
        """Return float32 [arms, 5]: the greatest error_mm and force in these rows, then the point
        between the jaws of the desired pose in the last row, m, frame 0. Maxima keep short peaks.
        """
        out = np.zeros((len(self._layout.arms), 5), np.float32)
        for i, arm in enumerate(self._layout.arms):
            places = self._layout.places
            out[i, 0] = frames[:, places[f"{arm}/error_mm"]].max()
            out[i, 1] = np.linalg.norm(frames[:, places[f"{arm}/force"]], axis=1).max()
            joints = frames[-1, places[f"{arm}/jpos_d"]].tolist()
            out[i, 2:] = closing_point(arm, tip_pose(arm, joints)[0].tolist(), joints)
        return out

    def _draw(self):
        # Draws the scene as in the newest frame, if any window shows the scene.
        if self._frames.written and self._server.watching:
            _, rows = self._frames.read(self._frames.written - 1)
            if len(rows):
                row = with_tips(self._layout, rows[-1].view(np.float32))
                self._scene.update(Frame(self._layout, row))

    def _speed_up(self):
        # Shows frames at the shortest interval for a while, because the operator's input changed.
        self._fast_until = time.monotonic() + FAST_S
        self._changed.set()
