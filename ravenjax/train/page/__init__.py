"""Serves the page of a training session to browsers, in a separate process.

The page reads frames and events from rings in shared memory. It writes the browsers' commands into
another ring, which the realtime process reads once a tick. The realtime process never waits for the
page. This module opens the page's port at once and answers browsers until the page has started. So
it imports no slow module.
"""

import contextlib
import dataclasses
import hmac
import importlib
import ipaddress
import secrets
import socket
import threading
from collections.abc import Callable
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ravenjax.errors import UserError

STATIC = Path(__file__).resolve().parent / "static"
_PORTS = 100
"""Number of ports to try, from the requested port on."""
# Not 503, which browsers report as an error.
_WAITING = (
    "HTTP/1.1 200 OK\r\nContent-Type: text/html; charset=utf-8\r\n"
    "Cache-Control: no-store\r\nConnection: close\r\nRefresh: 1\r\n\r\n"
)
_PATIENCE_S = 0.2
"""The longest wait for a request: browsers also open connections without a request."""


@dataclasses.dataclass(frozen=True)
class PageOptions:
    """The options that the page's process receives, pickled."""

    frames: str  # name of the ring of frames
    events: str  # name of the ring of events
    # Name of the ring of commands, which the page writes.
    commands: str
    arms: Any
    # As in session.json: name, hazards, task, blinded; also cue_threshold_mm.
    header: dict[str, Any]
    folder: str | None = None  # of the session, which gets debrief.html after the end
    host: str = "127.0.0.1"
    token: str | None = None  # Token of every request; needed if `host` is not a loopback address
    # Token of an instructor's window; None: there is no instructor.
    instructor_token: str | None = None


def is_loopback(host: str) -> bool:
    """Whether only this machine can reach a server on `host`."""
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def same_secret(word: str, secret: str | None) -> bool:
    """Whether `word` is the secret; False if there is no secret (None). The time of the comparison
    does not depend on the number of equal characters.
    """
    return secret is not None and hmac.compare_digest(
        word.encode(errors="replace"), secret.encode()
    )


def query_parameters(path: str) -> dict[str, str]:
    """Return the parameters of a request's path, the last of each name."""
    return {name: values[-1] for name, values in parse_qs(urlsplit(path).query).items()}


def choose_tokens(host: str, token: str | None, instructor: str | None) -> tuple[str | None, str]:
    """Return the tokens of visitors and instructor. A token that is None is generated, but visitors
    need none if only this machine reaches the page. Raises UserError if both are the same.
    """
    if token is None and not is_loopback(host):
        token = secrets.token_urlsafe(24)
    if token and token == instructor:
        raise UserError(
            "token and instructor_token are the same, so an operator could act as instructor:"
            " give different ones"
        )
    return token, instructor or secrets.token_urlsafe(12)


def open_port(
    host: str, port: int, token: str | None, instructor: str, say: Callable[[str], None]
) -> socket.socket:
    """Return a socket that listens at this port or the next free port, and print the addresses for
    operator and instructor. Raises UserError if the page cannot listen at `host`.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    for number in range(port, port + _PORTS):
        try:
            listening = socket.create_server((host, number), family=family)
            break
        except (OSError, OverflowError) as error:
            last_error = error
    else:
        raise UserError(
            f"host is {host!r}, port {port}, where the page cannot listen ({last_error}); give an"
            " address of this machine: 127.0.0.1 for this machine only, 0.0.0.0 for every network"
        )
    number = listening.getsockname()[1]
    if port not in (0, number):
        say(f"port {port} is in use: the page is at port {number}")
    # A server on all networks is at this machine's address, too. IPv6 addresses need brackets.
    address = f"[{host}]" if ":" in host else host
    shown = "127.0.0.1" if host in ("0.0.0.0", "") else address
    url, query = f"http://{shown}:{number}/?role=", f"&token={token}" if token else ""
    say(f"operator: {url}operator{query}")
    say(f"instructor: {url}instructor{query}&instructor_token={instructor}")
    return listening


def run_when_told(session: Connection, listening: socket.socket) -> None:
    """Import the page, then serve it with the `PageOptions` that `session` sends. Until then,
    browsers show the texts that `session` sends, such as what the session waits for. The answer to
    the options is the port. The function returns when the session has ended.
    """
    # viser and MuJoCo take seconds to import, and only the page's process needs them.
    page = "ravenjax.train.page.process"
    importing = threading.Thread(target=importlib.import_module, args=(page,), daemon=True)
    importing.start()
    waiting_page, text = (STATIC / "waiting.html").read_text(encoding="utf-8"), ""
    options: PageOptions | None = None
    # EOFError: the session ended before the page began.
    with contextlib.suppress(EOFError):
        while options is None or importing.is_alive():
            for ready in wait([session, listening], _PATIENCE_S):
                if ready is listening:
                    _ask_to_wait(listening, waiting_page.replace("WAITING", text))
                elif isinstance(received := session.recv(), str):
                    text = received
                else:
                    options = received
        importlib.import_module(page).serve_page(options, listening, session)


def _ask_to_wait(listening: socket.socket, text: str):
    # Answers one browser, which then asks again after a second.
    visitor, _ = listening.accept()
    with visitor, contextlib.suppress(OSError):
        visitor.settimeout(_PATIENCE_S)
        visitor.recv(1 << 16)
        visitor.sendall((_WAITING + text).encode())
