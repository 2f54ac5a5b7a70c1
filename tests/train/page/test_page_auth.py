"""Who may come in: host, origin and token of requests."""

from __future__ import annotations

import pytest
from websockets.datastructures import Headers
from websockets.http11 import Request

from ravenjax.errors import UserError
from ravenjax.train.page import PageOptions, loopback
from ravenjax.train.page.auth import Auth, query

TOKEN = "s3cret-token"


def request(path="/", **headers):
    return Request(
        path, Headers({name.replace("_", "-"): value for name, value in headers.items()})
    )


def auth(token=None, host="127.0.0.1", port=8000):
    made = Auth(host, token)
    made.port = port
    return made


@pytest.mark.parametrize(
    "host", ["127.0.0.1:8000", "localhost:8000", "LOCALHOST:8000", "[::1]:8000"]
)
def test_the_servers_own_names_come_in(host):
    assert auth().refusal(request(Host=host)) is None


@pytest.mark.parametrize(
    "host", ["evil.example:8000", "127.0.0.1:8001", "127.0.0.1", "127.0.0.1.evil.example:8000", ""]
)
def test_a_rebound_name_does_not(host):
    assert "host" in (auth().refusal(request(Host=host)) or "")


def test_a_request_without_a_host_or_with_two_does_not():
    assert auth().refusal(request()) is not None
    headers = Headers({"Host": "127.0.0.1:8000"})
    headers["Host"] = "evil.example"
    assert auth().refusal(Request("/", headers)) is not None


@pytest.mark.parametrize(
    ("origin", "welcome"),
    [
        ("http://127.0.0.1:8000", True),
        ("http://evil.example", False),
        ("http://127.0.0.1:8001", False),
        ("http://localhost:8000", False),
        ("null", False),
    ],
)
def test_a_websocket_comes_from_the_own_page(origin, welcome):
    asked = request("/session", Host="127.0.0.1:8000", Origin=origin, Upgrade="websocket")
    assert (auth().refusal(asked) is None) == welcome


def test_another_sites_link_to_a_file_is_refused_and_counted():
    asked = auth()
    assert (
        asked.refusal(request("/debrief.html", Host="127.0.0.1:8000", Sec_Fetch_Site="cross-site"))
        is not None
    )
    assert asked.refused == 1


def test_with_a_token_each_request_carries_it():
    asked = auth(TOKEN, "0.0.0.0")
    at = "192.0.2.7:8000"
    assert asked.refusal(request(Host=at)) is not None
    assert asked.refusal(request("/?token=wrong", Host=at)) is not None
    assert asked.refusal(request(f"/?token={TOKEN}x", Host=at)) is not None
    assert asked.refusal(request(f"/?role=operator&token={TOKEN}", Host=at)) is None
    assert (
        asked.refusal(request("/static/page.js", Host=at, Cookie=f"ravenjax_8000={TOKEN}")) is None
    )
    assert (
        asked.refusal(request("/static/page.js", Host=at, Cookie=f"ravenjax_8001={TOKEN}"))
        is not None
    )
    assert (
        asked.refusal(request("/?token=%C3%A9%ff", Host=at, Cookie="ravenjax_8000=; =;;"))
        is not None
    )
    evil = request(
        f"/session?token={TOKEN}", Host=at, Origin="http://evil.example", Upgrade="websocket"
    )
    assert asked.refusal(evil) is not None


def test_a_token_in_the_address_becomes_a_cookie_that_scripts_cannot_read():
    asked = auth(TOKEN, "0.0.0.0")
    cookie = asked.cookie(request(f"/?token={TOKEN}", Host="a:8000")) or ""
    assert (
        cookie.startswith(f"ravenjax_8000={TOKEN};")
        and "HttpOnly" in cookie
        and "SameSite=Strict" in cookie
    )
    assert asked.cookie(request("/", Host="a:8000")) is None
    assert auth().cookie(request("/?token=x", Host="a:8000")) is None


def test_query_takes_the_last_of_each():
    assert query("/session?role=operator&role=instructor&window=a%20b") == {
        "role": "instructor",
        "window": "a b",
    }


@pytest.mark.parametrize(
    ("host", "own"),
    [
        ("127.0.0.1", True),
        ("::1", True),
        ("localhost", True),
        ("0.0.0.0", False),
        ("x.example", False),
    ],
)
def test_only_a_loopback_address_goes_without_a_token(host, own):
    assert loopback(host) == own
    given = {
        "frames": "f",
        "events": "e",
        "commands": "c",
        "port_taken": None,
        "arms": ("gold",),
        "header": {},
        "host": host,
    }
    if own:
        PageOptions(**given)
    else:
        with pytest.raises(UserError, match="token"):
            PageOptions(**given)
        PageOptions(**given, token="t")


def test_frames_come_at_30_hz_at_least():
    with pytest.raises(UserError, match="fps is 10"):
        PageOptions("f", "e", "c", None, ("gold",), {}, fps=10)  # type: ignore[arg-type]
