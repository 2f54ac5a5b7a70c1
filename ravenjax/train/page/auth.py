"""Checks every request and every websocket before it is served.

A browser delivers a request of a foreign page to a loopback port as readily as one of the server's
own page (DNS rebinding, cross-site websockets). Therefore the host must be the server's own name,
and the origin of a websocket must be the server's own page. If there is a token, each request
carries it: in the address (?token=...) once, in a cookie after that.
"""

import hmac
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

from websockets.datastructures import Headers, MultipleValuesError
from websockets.http11 import Request

LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


class Auth:
    """The checks of one server."""

    def __init__(self, host: str, token: str | None, port: int) -> None:
        self._names = {*LOOPBACK, host}
        self._token, self.port = token, port

    def refusal(self, request: Request) -> str | None:
        """Return why this request is refused; None if it is allowed."""
        try:
            urlsplit(request.path)
            return self._refusal(request)
        except ValueError as error:
            return f"the address or the origin is invalid ({error})"

    def _refusal(self, request: Request) -> str | None:
        host, origin, upgrade, site, cookies = (
            _header(request.headers, name)
            for name in ("Host", "Origin", "Upgrade", "Sec-Fetch-Site", "Cookie")
        )
        name, _, port = (host or "").lower().rpartition(":")
        # With a token any name is allowed: a foreign one has no cookie, and the names that lead to
        # this host are unknown.
        is_own = self._token is not None or (name in self._names and port == str(self.port))
        if host is None or not is_own:
            return f"host {host!r} is not this server's"
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return f"origin {origin!r} is not this server's page"
        if upgrade is None and site == "cross-site":
            return "another site asks for it"
        if self._token is None:
            return None
        words = [query_parameters(request.path).get("token", "")]
        try:
            cookie = SimpleCookie(cookies or "").get(self._cookie_name)
            words += [cookie.value] if cookie else []
        except CookieError:
            pass
        if not any(same_secret(word, self._token) for word in words):
            return (
                "the token is missing or wrong: open the address that was printed, with ?token=..."
            )
        return None

    def cookie(self, request: Request) -> str | None:
        """Return the cookie to set if the address has a token, so that later requests carry it."""
        if self._token is None or not query_parameters(request.path).get("token"):
            return None
        return f"{self._cookie_name}={self._token}; HttpOnly; SameSite=Strict; Path=/"

    @property
    def _cookie_name(self) -> str:
        # All ports of a host share cookies, so the name contains the port.
        return f"ravenjax_{self.port}"


def same_secret(word: str, secret: str | None) -> bool:
    """Compare in constant time; False if there is no secret."""
    return secret is not None and hmac.compare_digest(
        word.encode(errors="replace"), secret.encode()
    )


def query_parameters(path: str) -> dict[str, str]:
    """Return the parameters of a request's path, the last of each name."""
    return {name: values[-1] for name, values in parse_qs(urlsplit(path).query).items()}


def _header(headers: Headers, name: str) -> str | None:
    try:
        return headers.get(name)
    except MultipleValuesError:
        # No browser sends a header twice.
        return ""
