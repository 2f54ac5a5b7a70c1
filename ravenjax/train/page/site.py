"""What the server hands out over HTTP: viser's client with the page's own lines in it, static
files, the debrief.
"""

from __future__ import annotations

import gzip
import hmac
import http
import json
from pathlib import Path
from urllib.parse import urlsplit

import viser
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ravenjax.train.page.door import Door, query
from ravenjax.train.page.session_list import SessionList

STATIC = Path(__file__).resolve().parent / "static"
DEBRIEF = "debrief.html"
_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}
_EARLY = '<script src="/static/early.js"></script>'
_LOOK = '<link rel="stylesheet" href="/static/page.css">'
_LATE = (
    f'{_LOOK}<link rel="stylesheet" href="/static/instructor.css"><script type="module"'
    ' src="/static/page.js"></script>'
)


class PageSite:
    """The files of one session. A request that is not for one of them gets 404, a stranger's
    403.
    """

    def __init__(self, door: Door, folder: str | None, instructor_token: str | None = None) -> None:
        """instructor_token: opens the list of sessions in the folder's folder; None: nobody sees
        it.
        """
        self._door, self._instructor_token = door, instructor_token
        self._sessions = SessionList(Path(folder).parent) if folder and instructor_token else None
        self._debrief = Path(folder) / DEBRIEF if folder else None
        self._files = {
            f"/static/{path.name}": _packed(path)
            for path in STATIC.iterdir()
            if path.suffix in _TYPES
        }
        self._pages = {kind: gzip.compress(text.encode(), 6) for kind, text in _pages().items()}

    def answer(self, request: Request) -> Response | None:
        """The response; None lets a websocket through."""
        reason = self._door.refusal(request)
        if reason is not None:
            return self._response(http.HTTPStatus.FORBIDDEN, "text/plain", f"{reason}\n".encode())
        if (request.headers.get("Upgrade") or "").lower() == "websocket":
            return None
        path = urlsplit(request.path).path
        ready = self._debrief is not None and self._debrief.is_file()
        if path == "/debrief.json":
            return self._response(
                http.HTTPStatus.OK, "application/json", json.dumps({"ready": ready}).encode()
            )
        if path == f"/{DEBRIEF}" and self._debrief is not None and ready:
            return self._response(http.HTTPStatus.OK, _TYPES[".html"], self._debrief.read_bytes())
        if path.startswith("/sessions"):
            return self._past(request, path)
        if path == "/":
            wishes = query(request.path)
            page = (
                "inset"
                if "inset" in wishes
                else "panel"
                if wishes.get("scene") == "off"
                else "scene"
            )
            kind, body = _TYPES[".html"], self._pages[page]
        elif path in self._files:
            kind, body = self._files[path]
        else:
            return self._response(http.HTTPStatus.NOT_FOUND, "text/plain", b"no such page\n")
        extra = {"Content-Encoding": "gzip"}
        cookie = self._door.cookie(request)
        if cookie:
            extra["Set-Cookie"] = cookie
        if path == "/":
            extra["Content-Security-Policy"] = _policy(request.headers["Host"])
        return self._response(http.HTTPStatus.OK, kind, body, extra)

    def _past(self, request: Request, path: str) -> Response:
        """The list of sessions, or a debrief out of it: the instructor's alone."""
        expected = (self._instructor_token or "").encode()
        word = query(request.path).get("instructor_token", "")
        if self._sessions is None or not hmac.compare_digest(word.encode(), expected):
            return self._response(
                http.HTTPStatus.FORBIDDEN,
                "text/plain",
                b"the list of sessions is the instructor's\n",
            )
        body = self._sessions.page(word) if path == "/sessions" else self._sessions.debrief(path)
        if body is None:
            return self._response(http.HTTPStatus.NOT_FOUND, "text/plain", b"no such session\n")
        return self._response(http.HTTPStatus.OK, _TYPES[".html"], body)

    def _response(
        self, status: http.HTTPStatus, kind: str, body: bytes, extra: dict[str, str] | None = None
    ) -> Response:
        fixed = {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            "X-Frame-Options": "SAMEORIGIN",
            "Referrer-Policy": "no-referrer",  # the address may hold the token
        }
        return Response(status.value, status.phrase, Headers({**fixed, **(extra or {})}), body)


_PLAIN = (
    '<!doctype html><html lang="en"><head><meta charset="utf-8" /><link rel="icon" href="data:," />'
    '<meta name="viewport" content="width=device-width, initial-scale=1" />'
    "<title>ravenjax</title></head><body>PANEL</body></html>"
)


def _pages() -> dict[str, str]:
    """Viser's client, which is one self-contained page, with the session's panel over it; the panel
    alone; and the client alone, for a small second picture."""
    panel = (STATIC / "panel.html").read_text(encoding="utf-8")
    plain = (
        _PLAIN.replace("<head>", f"<head>{_EARLY}")
        .replace("</head>", f"{_LATE}</head>")
        .replace("PANEL", panel)
    )
    client = (Path(viser.__file__).parent / "client" / "build" / "index.html").read_text(
        encoding="utf-8"
    )
    return {
        "panel": plain,
        "scene": _scene(client, _LATE, panel),
        "inset": _scene(client, _LOOK, ""),
    }


def _scene(client: str, late: str, panel: str) -> str:
    text = client.replace("<head>", f"<head>{_EARLY}", 1).replace(
        "<title>Viser</title>", "<title>ravenjax</title>", 1
    )
    head, _, rest = text.rpartition("</head>")
    text = f"{head}{late}</head>{rest}".replace(
        '<div id="root"></div>', f'<div id="root"></div>{panel}', 1
    )
    missing = [part for part in (_EARLY, late, panel) if part not in text]
    if missing:
        raise RuntimeError(
            f"viser {viser.__version__}: its client's page has no place for {missing[0][:60]!r}"
        )
    return text


def _policy(host: str) -> str:
    """No request of the page leaves the server, whatever an address or a scene asks for."""
    return (
        "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:"
        " data:; style-src 'self' 'unsafe-inline'; worker-src blob: data:; connect-src 'self'"
        f" ws://{host} wss://{host} data: blob:; frame-ancestors 'self'; base-uri 'none'"
    )


def _packed(path: Path) -> tuple[str, bytes]:
    return _TYPES[path.suffix], gzip.compress(path.read_bytes(), 6)
