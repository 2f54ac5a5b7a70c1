"""What a browser may say: everything else is dropped before it reaches the session."""

from __future__ import annotations

import json

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.train.page.inbox import LARGEST, Inbox, RefusedMessage
from ravenjax.train.protocol import messages

ROLES = ("operator", "watcher", "instructor")
INBOX = Inbox(("gold", "green"), hazards=3, blinded=False)
INPUT = {
    "type": "input",
    "source": "keyboard",
    "pedal": True,
    "arms": {"gold": {"move": [1, 0, -0.5], "turn": [0, 0, 0], "grasp": 1}},
}


def read(message, role="operator", inbox=INBOX):
    return inbox.read(json.dumps(message), role)


def test_input_arrives_as_messages_describes_it():
    told = read(INPUT)
    assert told["arms"]["gold"] == {"move": [1.0, 0.0, -0.5], "turn": [0.0, 0.0, 0.0], "grasp": 1.0}
    assert (told["type"], told["source"], told["pedal"]) == ("input", "keyboard", True)


@pytest.mark.parametrize(
    "change",
    [
        {"pedal": 1},
        {"pedal": None},
        {"source": "itp"},
        {"extra": 1},
        {"arms": {"red": {}}},
        {"arms": {"gold": {"move": [0, 0]}}},
        {"arms": {"gold": {"move": [0, 0, 1.01]}}},
        {"arms": {"gold": {"move": [0, 0, "1"]}}},
        {"arms": {"gold": {"grasp": 2}}},
        {"arms": {"gold": {"jaw": 0}}},
        {"arms": []},
        {"type": "increments"},
    ],
)
def test_input_out_of_bounds_is_refused(change):
    with pytest.raises(RefusedMessage):
        read(INPUT | change)


@pytest.mark.parametrize(
    "text",
    ["", "null", "[]", "{", '"x"', "NaN", '{"type": "input"}', "[" * 900, b"\xff\xfe", b"\x00"],
)
def test_what_is_no_message_is_refused(text):
    with pytest.raises(RefusedMessage):
        INBOX.read(text, "operator")


@pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999"])
def test_numbers_are_finite(number):
    text = json.dumps(INPUT).replace("-0.5", number)
    with pytest.raises(RefusedMessage):
        INBOX.read(text, "operator")


def test_size_is_bounded():
    with pytest.raises(RefusedMessage, match="bytes"):
        INBOX.read(json.dumps(INPUT) + " " * LARGEST, "operator")


def test_an_arm_that_the_session_lacks_is_refused():
    with pytest.raises(RefusedMessage, match="arm green"):
        read(INPUT | {"arms": {"green": {}}}, inbox=Inbox(("gold",), 0, False))


@pytest.mark.parametrize("do", messages.OPERATOR)
def test_who_may_do_what_operators_do(do):
    message = {"type": "operator", "do": do} | ({"text": "hm"} if do == "note" else {})
    allowed = {role for role in ROLES if not _refused(message, role)}
    expected = {"estop": set(ROLES), "note": {"operator", "instructor"}}.get(do, {"operator"})
    assert allowed == expected


@pytest.mark.parametrize("do", messages.INSTRUCTOR)
def test_only_instructors_do_what_instructors_do(do):
    message = {"type": "instructor", "do": do} | {"arm": {"hazard": 2}, "cue": {"on": False}}.get(
        do, {}
    )
    assert {role for role in ROLES if not _refused(message, role)} == {"instructor"}


def test_watchers_neither_drive_nor_note_and_they_alone_take_the_seat():
    assert _refused(INPUT, "watcher") and _refused(INPUT, "instructor")
    take = {"type": "page", "do": "take"}
    assert {role for role in ROLES if not _refused(take, role)} == {"watcher"}


def test_hazards_and_cue_are_checked():
    assert _refused({"type": "instructor", "do": "arm", "hazard": 3}, "instructor")
    assert _refused({"type": "instructor", "do": "arm", "hazard": -1}, "instructor")
    assert _refused({"type": "instructor", "do": "arm"}, "instructor")
    assert _refused({"type": "instructor", "do": "pause", "on": True}, "instructor")
    assert _refused({"type": "instructor", "do": "cue"}, "instructor")
    with pytest.raises(RefusedMessage, match="blinded"):
        Inbox(("gold",), 1, True).read(
            '{"type": "instructor", "do": "cue", "on": true}', "instructor"
        )


def test_a_note_fits_in_an_event():
    assert read({"type": "operator", "do": "note", "text": "x" * 600})["text"] == "x" * 600
    assert _refused({"type": "operator", "do": "note", "text": "é" * 200}, "operator")
    assert _refused({"type": "operator", "do": "estop", "text": "now"}, "operator")
    assert _refused({"type": "operator", "do": "note"}, "operator")


JSON = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from(["gold", "input"]),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(
                [
                    "type",
                    "do",
                    "arms",
                    "gold",
                    "move",
                    "turn",
                    "grasp",
                    "pedal",
                    "source",
                    "on",
                    "hazard",
                    "x",
                ]
            ),
            inner,
            max_size=5,
        )
    ),
    max_leaves=12,
)


@pytest.mark.slow
@settings(max_examples=300)
@given(
    st.binary(max_size=60)
    | JSON.map(json.dumps)
    | JSON.map(lambda part: json.dumps(INPUT | {"arms": part}))
)
def test_nothing_gets_through_that_is_not_described(text):
    for role in ROLES:
        try:
            told = INBOX.read(text, role)
        except RefusedMessage:
            continue
        assert told["type"] in ("input", "operator", "instructor", "page")
        if told["type"] == "input":
            assert (
                role == "operator"
                and isinstance(told["pedal"], bool)
                and set(told["arms"]) <= {"gold", "green"}
            )
            for hand in told["arms"].values():
                assert all(-1 <= x <= 1 for x in (*hand["move"], *hand["turn"], hand["grasp"]))


def _refused(message, role):
    try:
        read(message, role)
    except RefusedMessage:
        return True
    return False


def test_only_an_instructor_asks_for_the_next_session_and_names_no_path():
    inbox = Inbox(("gold", "green"), 0, blinded=False)
    wish = {
        "type": "instructor",
        "do": "next",
        "participant": "P1",
        "scenario": "dac_burst",
        "seed": 3,
    }
    with pytest.raises(RefusedMessage, match=r"no scenario dac_bust; there are .*dac_burst"):
        Inbox(("gold",), 1, False).read(json.dumps(wish | {"scenario": "dac_bust"}), "instructor")
    assert inbox.read(json.dumps(wish), "instructor") == wish
    for role in ("operator", "watcher"):
        with pytest.raises(RefusedMessage):
            inbox.read(json.dumps(wish), role)
    for change in (
        {"scenario": "../secret"},
        {"seed": -1},
        {"participant": "x" * 41},
        {"do": "start"},
    ):
        with pytest.raises(RefusedMessage):
            inbox.read(json.dumps(wish | change), "instructor")
