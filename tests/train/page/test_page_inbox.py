"""What a browser may say: everything else is dropped before it reaches the session."""

import json

import pytest

from ravenjax.train.page.hub import _COMMANDS, MAX_MESSAGE_BYTES, Inbox, RefusedMessage

ROLES = ("operator", "watcher", "instructor")
INBOX = Inbox(("gold", "green"), hazards=3, blinded=False)
INPUT = {
    "type": "input",
    "source": "keyboard",
    "pedal": True,
    "arms": {"gold": {"move": [1, 0, -0.5], "turn": [0, 0, 0], "grasp": 1}},
}
NEXT = {"do": "next", "participant": "P1", "scenario": "dac_burst", "seed": 3}


def read(message, role="operator", inbox=INBOX):
    return inbox.read(message if isinstance(message, str) else json.dumps(message), role)


def senders(message):
    """The roles that may send it."""
    allowed = set()
    for role in ROLES:
        try:
            read(message, role)
            allowed.add(role)
        except RefusedMessage:
            continue
    return allowed


def test_input_arrives_as_messages_describes_it():
    hand = {"move": [1.0, 0.0, -0.5], "turn": [0.0, 0.0, 0.0], "grasp": 1.0}
    assert read(INPUT) == INPUT | {"arms": {"gold": hand}}


@pytest.mark.parametrize(
    "message",
    [
        *("", "null", "[]", "{", '"x"', "NaN", '{"type": "input"}', "[" * 900, "\x00"),
        *(json.dumps(INPUT).replace("-0.5", number) for number in ("NaN", "-Infinity", "1e999")),
        json.dumps(INPUT) + " " * MAX_MESSAGE_BYTES,
        INPUT | {"pedal": 1},
        INPUT | {"arms": {"gold": {"move": [0, 0]}}},
        INPUT | {"arms": {"gold": {"jaw": 0}}},
        INPUT | {"type": "increments"},
        {"type": "operator", "do": "note", "text": "é" * 200},
        {"type": "operator", "do": "estop", "text": "now"},
        {"type": "instructor", "do": "arm", "hazard": 3},
        {"type": "instructor", "do": "pause", "on": True},
        {"type": "instructor"} | NEXT | {"scenario": "../secret"},
        {"type": "instructor"} | NEXT | {"seed": -1},
        {"type": "instructor"} | NEXT | {"participant": "x" * 41},
        {"type": "instructor"} | NEXT | {"do": "start"},
    ],
)
def test_what_is_out_of_bounds_is_refused_from_everybody(message):
    assert senders(message) == set()


@pytest.mark.parametrize(
    ("message", "expected"),
    [
        (INPUT, "operator"),
        ({"type": "seat", "do": "take"}, "operator"),
        ({"type": "seat", "do": "give", "to": "itp"}, "operator instructor"),
        ({"type": "page", "do": "take"}, "watcher"),
        ({"type": "instructor"} | NEXT, "instructor"),
    ],
)
def test_who_may_say_what(message, expected):
    assert senders(message) == set(expected.split())


def test_operators_and_instructors_have_their_commands():
    for do in _COMMANDS["operator"]:
        expected = {"estop": set(ROLES), "note": {"operator", "instructor"}}
        message = {"type": "operator", "do": do} | ({"text": "hm"} if do == "note" else {})
        assert senders(message) == expected.get(do, {"operator"}), do
    for do in _COMMANDS["instructor"]:
        more = {"arm": {"hazard": 2}, "cue": {"on": False}}.get(do, {})
        assert senders({"type": "instructor", "do": do} | more) == {"instructor"}, do


def test_the_session_decides_on_arms_and_cue():
    with pytest.raises(RefusedMessage, match="arm green"):
        read(INPUT | {"arms": {"green": {}}}, inbox=Inbox(("gold",), 0, False))
    cue = {"type": "instructor", "do": "cue", "on": True}
    with pytest.raises(RefusedMessage, match="blinded"):
        read(cue, "instructor", Inbox(("gold",), 1, True))
