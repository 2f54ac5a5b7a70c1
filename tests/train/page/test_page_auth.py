"""Who may come in: host, origin and token of requests."""

import pytest
from websockets.datastructures import Headers
from websockets.http11 import Request

from ravenjax.errors import UserError
from ravenjax.train.page import choose_tokens, is_loopback
from ravenjax.train.page.process import Auth

TOKEN = "s3cret-token"
AT = "127.0.0.1:8000"
EVIL = "http://evil.example"


def request(path="/", **headers):
    return Request(
        path, Headers({name.replace("_", "-"): value for name, value in headers.items()})
    )


def auth(token=None, host="127.0.0.1"):
    return Auth(host, token, 8000)


@pytest.mark.parametrize(
    ("path", "headers", "welcome"),
    [
        *(("/", {"Host": host}, True) for host in (AT, "LOCALHOST:8000", "[::1]:8000")),
        *(("/", {"Host": host}, False) for host in ("evil.example:8000", "127.0.0.1", f"{AT}.x")),
        ("/", {}, False),
        ("//[", {"Host": AT}, False),
        ("/", {"Host": AT, "Origin": "http://["}, False),
        ("/session", {"Host": AT, "Origin": f"http://{AT}", "Upgrade": "websocket"}, True),
        ("/session", {"Host": AT, "Origin": EVIL, "Upgrade": "websocket"}, False),
        ("/session", {"Host": AT, "Origin": "http://localhost:8000"}, False),
        ("/session", {"Host": AT, "Origin": "null", "Upgrade": "websocket"}, False),
        ("/debrief.html", {"Host": AT, "Sec_Fetch_Site": "cross-site"}, False),
    ],
)
def test_only_the_servers_own_names_and_pages_come_in(path, headers, welcome):
    assert (auth().refusal(request(path, **headers)) is None) == welcome


@pytest.mark.parametrize(
    ("path", "headers", "welcome"),
    [
        ("/", {}, False),
        ("/?token=wrong", {}, False),
        (f"/?token={TOKEN}x", {}, False),
        (f"/?role=operator&token={TOKEN}", {}, True),
        # A second header with the same name.
        (f"/?token={TOKEN}", {"HOST": "192.0.2.7:8000"}, False),
        ("/static/page.js", {"Cookie": f"ravenjax_8000={TOKEN}"}, True),
        ("/static/page.js", {"Cookie": f"ravenjax_8001={TOKEN}"}, False),
        ("/?token=%C3%A9%ff", {"Cookie": "ravenjax_8000=; =;;"}, False),
        (f"/session?token={TOKEN}", {"Origin": EVIL, "Upgrade": "websocket"}, False),
    ],
)
def test_with_a_token_each_request_carries_it(path, headers, welcome):
    asked = request(path, Host="192.0.2.7:8000", **headers)
    assert (auth(TOKEN, "0.0.0.0").refusal(asked) is None) == welcome


@pytest.mark.parametrize(
    ("host", "is_own"),
    [("127.0.0.1", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("x.x", False)],
)
def test_only_a_loopback_address_goes_without_a_token(host, is_own):
    assert is_loopback(host) == is_own
    token, key = choose_tokens(host, None, None)
    assert (token is None) == is_own and key and choose_tokens(host, "t", "i") == ("t", "i")
    with pytest.raises(UserError, match="give different ones"):
        choose_tokens(host, "t", "t")
