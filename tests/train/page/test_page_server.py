"""The page's process with a session of its own: who gets what, and what reaches the session."""

import http.client
import json
import time

import numpy as np
import pytest
import waiting
from fake_session import AS_INSTRUCTOR
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from ravenjax.robots.raven2 import ROBOT

PRESSED = {
    "type": "input",
    "source": "keyboard",
    "pedal": True,
    "arms": {"gold": {"move": [1, 0, 0]}},
}


class Window:
    """A browser's end of the websocket."""

    def __init__(self, session, role="operator", **headers):
        query = AS_INSTRUCTOR if role == "instructor" else f"role={role}"
        address = f"ws://127.0.0.1:{session.port}/session?{query}"
        self.socket = connect(address, additional_headers=headers, open_timeout=waiting.DEADLINE_S)
        self.welcome = self.text("welcome")
        self.layout, self.first = self.welcome["layout"], 5 * len(self.welcome["arms"])

    def say(self, told):
        self.socket.send(told if isinstance(told, str | bytes) else json.dumps(told))

    def text(self, what=None, timeout=waiting.DEADLINE_S, **parts):
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            message = self.socket.recv(timeout=timeout)
            if isinstance(message, str):
                told = json.loads(message)
                if what in (None, told["type"]) and all(
                    told.get(name) == value for name, value in parts.items()
                ):
                    return told
        raise AssertionError(f"nothing of {what} with {parts}")

    def pong(self):
        """The refusal of an unknown command, None where it is dropped; among ten messages."""
        self.say({"type": "page", "do": "ping"})
        for _ in range(10):
            message = self.socket.recv(timeout=waiting.DEADLINE_S)
            if isinstance(message, str) and (told := json.loads(message)).get("why"):
                return told
        return None

    def frame(self):
        while True:
            message = self.socket.recv(timeout=waiting.DEADLINE_S)
            if isinstance(message, bytes):
                return np.frombuffer(message, np.float32)

    def until(self, name, wanted, timeout=waiting.DEADLINE_S):
        """The first frame in which a channel's number is `wanted` (a predicate)."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            numbers = self.frame()
            if wanted(numbers[self.first + self.layout[name][0]]):
                return numbers
        raise AssertionError(f"{name} did not come")

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.socket.close()


def get(session, path, method="GET", **headers):
    connection = http.client.HTTPConnection("127.0.0.1", session.port, timeout=waiting.DEADLINE_S)
    named = {name.replace("_", "-"): value for name, value in headers.items()}
    connection.request(method, path, b"x" * 9 if method == "POST" else None, named)
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer, body


def refused(session, path="", **headers):
    address = f"ws://127.0.0.1:{session.port}/session{path}"
    with pytest.raises(InvalidStatus) as error:
        connect(address, additional_headers=headers, open_timeout=waiting.DEADLINE_S)
    return error.value.response.status_code


def test_pages_and_files(session):
    answer, body = get(session, "/")
    assert answer.status == 200 and answer.getheader("Content-Encoding") == "gzip"
    assert len(body) > 100_000
    policy = answer.getheader("Content-Security-Policy") or ""
    assert f"connect-src 'self' ws://127.0.0.1:{session.port} " in policy
    assert "frame-ancestors 'self'" in policy
    assert len(get(session, "/?scene=off")[1]) < 20_000
    assert (
        get(session, "/static/page.js")[0].getheader("Content-Type")
        == "text/javascript; charset=utf-8"
    )
    escapes = ("/static/../hub.py", "/static/%2e%2e/hub.py")
    for path in (*escapes, "/etc/passwd", "/index.html", "/debrief.html"):
        assert get(session, path)[0].status == 404
    assert json.loads(get(session, "/debrief.json")[1]) == {"ready": False, "table": False}
    for method in ("HEAD", "POST"):
        answer, _ = get(session, "/", method)
        assert answer.status == 405 and answer.getheader("Allow") == "GET"


def test_an_operator_drives_and_letting_go_releases(session):
    with Window(session) as window:
        assert window.welcome["role"] == "operator" and "hazards" not in window.welcome["header"]
        assert window.welcome["run_levels"] == list(ROBOT.run_levels)
        start = window.frame()
        first = window.first + window.layout["gold/tip"][0]
        tip = slice(first, first + 3)
        window.say(PRESSED)
        window.until("runlevel", lambda level: level == 3)
        for _ in range(100):
            moved = window.frame()
            if np.abs(moved[tip] - start[tip]).max() > 1e-5:
                break
        else:
            raise AssertionError("the tip stands still")
        before = len(session.commands)
    released = {"type": "seat", "do": "left"}
    waiting.until(
        lambda: any(released.items() <= one.items() for one in session.commands[before:]),
        "a closed window did not let go of the pedal",
    )


def test_one_drives_and_the_next_looks_on_until_the_seat_is_free(session):
    with Window(session) as second_try:
        assert second_try.welcome["role"] == "operator"
        with Window(session) as watcher:
            assert watcher.welcome["role"] == "watcher"
            watcher.say(PRESSED)
            assert "watcher" in watcher.text("refused")["why"]
            watcher.say({"type": "page", "do": "take"})
            second_try.socket.close()
            assert watcher.text("seat")["free"] is True
            watcher.say({"type": "page", "do": "take"})
            assert watcher.text("welcome")["role"] == "operator"


def test_what_is_malformed_oversized_or_too_much_is_dropped(session):
    with Window(session) as window:
        before = len(session.commands)
        for bad in ("{", b"\x00" * 50, "x" * 5000):
            window.say(bad)
            window.text("refused")
        for _ in range(600):
            window.say('{"type": "page", "do": "ping"}')
        waiting.until(window.pong, "the window is not heard again")
        # an earlier window may still be letting go of what it held
        assert not any(one.get("pedal") or one.get("arms") for one in session.commands[before:])
        window.say(PRESSED)
        hand = {"move": [1.0, 0.0, 0.0], "turn": [0.0, 0.0, 0.0], "grasp": 0.0}
        session.heard(**PRESSED | {"arms": {"gold": hand}})


def test_the_instructor_arms_and_the_operator_does_not_see_it(session):
    with Window(session) as operator, Window(session, "instructor") as instructor:
        assert [one["hazard"] for one in instructor.welcome["header"]["hazards"]] == ["C09", "L7"]
        operator.say(PRESSED)
        instructor.say({"type": "instructor", "do": "arm", "hazard": 1})
        armed = instructor.text("event", kind="hazard_armed")
        assert armed["number"] == 1 and "row" not in armed
        instructor.text("event", kind="hazard_struck")
        numbers = instructor.until("hazard", lambda number: number == 1)
        # And the force that goes with it.
        assert instructor.until("gold/error_mm", lambda error: error > 3)[1] > 0
        seen = [operator.frame() for _ in range(20)]
        at = operator.first + operator.layout["hazard"][0]
        assert {float(one[at]) for one in seen} == {-1.0} and len(numbers) == len(seen[0])
        operator.say(PRESSED | {"pedal": False})
        told = operator.text("event", kind="response")
        assert told["ok"] is True
        instructor.text("event", kind="hazard_over", outcome="avoided")
    with Window(session) as late:
        kinds = {event["kind"] for event in late.welcome["events"]}
        assert {"alarm", "cue", "response"} <= kinds
        assert not kinds & {"hazard_armed", "hazard_struck", "hazard_over"}


@pytest.mark.parametrize("token", ["", "&instructor_token=guess", "&instructor_token=%C3%A9"])
def test_nobody_instructs_without_the_instructors_own_token(session, token):
    before = len(session.commands)
    with Window(session, f"instructor&window=w{token}") as stranger:
        assert (stranger.welcome["role"], stranger.welcome["instructs"]) == ("watcher", False)
        assert "hazards" not in stranger.welcome["header"]
        stranger.say({"type": "page", "do": "instruct"})
        stranger.say({"type": "instructor", "do": "pause"})
        assert "watcher" in stranger.text("refused")["why"]
    assert not [one for one in session.commands[before:] if one["type"] == "instructor"]


def test_a_second_instructor_sits_down_by_a_word_of_their_own(session):
    with Window(session, "instructor") as first, Window(session, "instructor") as second:
        assert (first.welcome["role"], second.welcome["role"]) == ("instructor", "watcher")
        assert second.welcome["instructs"] and "hazards" not in second.welcome["header"]
        second.say({"type": "instructor", "do": "pause"})
        assert "watcher" in second.text("refused")["why"]
        second.say({"type": "page", "do": "instruct"})
        assert second.text("welcome")["role"] == "instructor"
    with Window(session, "instructor") as alone:
        assert alone.welcome["role"] == "instructor"


def test_a_window_that_comes_back_has_its_place_and_its_pedal_is_let_go(session):
    with Window(session, "operator&window=mine") as before:
        assert before.welcome["role"] == "operator"
        at = len(session.commands)
        with Window(session, "operator&window=mine") as again:
            assert again.welcome["role"] == "operator"
            waiting.until(lambda: any(one.get("do") == "left" for one in session.commands[at:]))
            with pytest.raises(ConnectionClosed):
                for _ in range(1000):
                    before.frame()
