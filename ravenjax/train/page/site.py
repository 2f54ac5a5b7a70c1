"""What the server hands out over HTTP: viser's client with the page's own lines in it, static
files, the debrief, and for the instructor the sessions beside the present one.
"""

from __future__ import annotations

import gzip
import json
from http import HTTPStatus
from pathlib import Path
from typing import Any
from urllib.parse import quote, urlsplit

import viser
from websockets.datastructures import Headers
from websockets.http11 import Request, Response

from ravenjax.train.page.auth import Auth, query, same_secret
from ravenjax.train.recording import folders

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
_WITHOUT_SCENE = (
    f'<!doctype html><html lang="en"><head>{_EARLY}<meta charset="utf-8" />'
    '<link rel="icon" href="data:," />'
    '<meta name="viewport" content="width=device-width, initial-scale=1" />'
    f"<title>ravenjax</title>{_LATE}</head><body>PANEL</body></html>"
)


class PageSite:
    """The files of one session. A request that is not for one of them gets 404, a stranger's
    403.
    """

    def __init__(self, auth: Auth, folder: str | None, instructor_token: str | None = None) -> None:
        """instructor_token: opens the list of sessions in the folder's folder; None: nobody sees
        it.
        """
        self._auth, self._instructor_token = auth, instructor_token
        self._folder = Path(folder) if folder else None
        self._files = {
            f"/static/{path.name}": (_TYPES[path.suffix], gzip.compress(path.read_bytes(), 6))
            for path in STATIC.iterdir()
            if path.suffix in _TYPES
        }
        self._pages = {kind: gzip.compress(text.encode(), 6) for kind, text in _pages().items()}

    def answer(self, request: Request) -> Response | None:
        """The response; None lets a websocket through."""
        reason = self._auth.refusal(request)
        if reason is not None:
            return _plain_response(HTTPStatus.FORBIDDEN, reason)
        if (request.headers.get("Upgrade") or "").lower() == "websocket":
            return None
        path, parameters = urlsplit(request.path).path, query(request.path)
        debrief = self._folder / DEBRIEF if self._folder else None
        has_debrief = debrief is not None and debrief.is_file()
        if path == "/debrief.json":
            ready = json.dumps({"ready": has_debrief}).encode()
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
            extra["Content-Security-Policy"] = _policy(request.headers["Host"])
            return _response(HTTPStatus.OK, _TYPES[".html"], body, extra)
        if path in self._files:
            return _response(HTTPStatus.OK, *self._files[path], extra)
        return _plain_response(HTTPStatus.NOT_FOUND, "no such page")

    def _earlier_session(self, path: str, token: str) -> Response:
        """The list of sessions, or a debrief out of it: the instructor's alone."""
        if self._folder is None or not same_secret(token, self._instructor_token):
            return _plain_response(HTTPStatus.FORBIDDEN, "the list of sessions is the instructor's")
        sessions = folders.beside(self._folder.parent)
        if path == "/sessions":
            # jinja takes a while to import.
            from ravenjax.document import html

            template = html.environment("ravenjax.train").get_template("sessions.html.j2")
            rows = [_session_row(session, token) for session in reversed(sessions)]
            text = template.render(rows=rows, folder=str(self._folder.parent))
            return _response(HTTPStatus.OK, _TYPES[".html"], text.encode())
        for session in sessions:
            file = session.path / DEBRIEF
            if path == _debrief_address(session) and file.is_file():
                return _response(HTTPStatus.OK, _TYPES[".html"], file.read_bytes())
        return _plain_response(HTTPStatus.NOT_FOUND, "no such session")


def _debrief_address(session: folders.SessionFolder) -> str:
    return f"/sessions/{quote(session.path.name)}/{DEBRIEF}"


def _session_row(session: folders.SessionFolder, token: str) -> dict[str, Any]:
    header, summary = session.header, session.summary
    hazards = summary.get("hazards") or {}
    address = f"{_debrief_address(session)}?instructor_token={quote(token)}"
    return {
        "name": session.path.name,
        "started": session.started[:16].replace("T", " "),
        "scenario": session.scenario,
        "participant": session.participant,
        "group": "blinded" if header.get("blinded") else str(header.get("group") or ""),
        "seconds": (summary.get("ticks") or 0) / 1000 or None,
        "score": hazards.get("score"),
        "reaction_ms": hazards.get("median_reaction_ms"),
        "ended": str(summary.get("ended") or "cut short"),
        "address": address if (session.path / DEBRIEF).is_file() else "",
    }


def _plain_response(status: HTTPStatus, text: str) -> Response:
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
        # The address may hold the token.
        "Referrer-Policy": "no-referrer",
    }
    return Response(status.value, status.phrase, Headers({**headers, **(extra or {})}), body)


def _pages() -> dict[str, str]:
    """Viser's client, which is one self-contained page, with the session's panel over it; the panel
    alone; and the client alone, for a small second picture."""
    panel = (STATIC / "panel.html").read_text(encoding="utf-8")
    client = Path(viser.__file__).parent / "client" / "build" / "index.html"
    text = client.read_text(encoding="utf-8")
    return {
        "panel": _WITHOUT_SCENE.replace("PANEL", panel),
        "scene": _with_scene(text, _LATE, panel),
        "inset": _with_scene(text, _LOOK, ""),
    }


def _with_scene(client: str, late: str, panel: str) -> str:
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


def _policy(host: str) -> str:
    """No request of the page leaves the server, whatever an address or a scene asks for."""
    return (
        "default-src 'self' data: blob:; script-src 'self' 'unsafe-inline' 'unsafe-eval' blob:"
        " data:; style-src 'self' 'unsafe-inline'; worker-src blob: data:; connect-src 'self'"
        f" ws://{host} wss://{host} data: blob:; frame-ancestors 'self'; base-uri 'none'"
    )
