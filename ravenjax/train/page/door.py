"""Who may come in: the checks that every request and every websocket passes before anything is
served.

A browser sends a page of a stranger to a loopback port as readily as its own (DNS rebinding,
cross-site websockets). So the host must be the server's own name, the origin of a websocket the
server's own page, and where there is a token each request carries it: in the address (?token=...)
once, in a cookie after that.
"""

from __future__ import annotations

import hmac
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from websockets.datastructures import Headers, MultipleValuesError
from websockets.http11 import Request

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


class Door:
    """The checks of one server."""

    def __init__(self, host: str, token: str | None) -> None:
        self._names = {*LOOPBACK, host}
        self._token = token
        self.port = 0  # known once the server is bound
        self.refused = 0

    def refusal(self, request: Request) -> str | None:
        """Why this request is not served; None where it is. Counts refusals."""
        reason = self._reason(request)
        self.refused += reason is not None
        return reason

    def _reason(self, request: Request) -> str | None:
        host = _header(request.headers, "Host")
        if host is None or not self._is_mine(host):
            return f"host {host!r} is not this server's"
        origin = _header(request.headers, "Origin")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return f"origin {origin!r} is not this server's page"
        if _header(request.headers, "Upgrade") is None and (
            _header(request.headers, "Sec-Fetch-Site") == "cross-site"
        ):
            return "another site asks for it"
        if self._token is not None and not any(self._fits(word) for word in self._words(request)):
            return (
                "the token is missing or wrong: open the address that was printed, with ?token=..."
            )
        return None

    def cookie(self, request: Request) -> str | None:
        """The cookie to set where a token came with the address: what the page asks for carries
        it from now.
        """
        if self._token is None or not query(request.path).get("token"):
            return None
        return f"{self._cookie_name}={self._token}; HttpOnly; SameSite=Strict; Path=/"

    @property
    def _cookie_name(self) -> str:
        return f"ravenjax_{self.port}"  # cookies are shared by all ports of a host

    def _is_mine(self, host: str) -> bool:
        if self._token is not None:
            return True  # a stranger's name has no cookie; which names lead here is not known
        name, _, port = host.lower().rpartition(":")
        return name in self._names and port == str(self.port)

    def _words(self, request: Request) -> list[str]:
        words = [query(request.path).get("token", "")]
        try:
            cookie = SimpleCookie(_header(request.headers, "Cookie") or "").get(self._cookie_name)
        except CookieError:
            cookie = None
        return [*words, cookie.value] if cookie else words

    def _fits(self, word: str) -> bool:
        return hmac.compare_digest(word.encode(), (self._token or "").encode())


def query(path: str) -> dict[str, str]:
    """Parameters of a request's path, the last of each name."""
    return {name: values[-1] for name, values in parse_qs(urlsplit(path).query).items()}


def _header(headers: Headers, name: str) -> str | None:
    try:
        return headers.get(name)
    except MultipleValuesError:
        return ""  # no browser sends it twice
