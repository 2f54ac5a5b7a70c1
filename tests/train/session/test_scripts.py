"""Scripted and recorded operators, alone and in a whole session."""

import json

import pytest
from made_frames import TIPS, made, running

from ravenjax.errors import UserError
from ravenjax.train import tasks
from ravenjax.train.protocol import PHASES
from ravenjax.train.session.scripts import INPUT_EVERY_MS, Follower, read_commands


def follower(reaction="release"):
    chosen, _ = made(task={"kind": "reach"})
    task = tasks.make_task(chosen, TIPS, 0)
    return Follower(task, ("gold",), chosen.speeds, reaction), task


def said(operator, frame, first, last):
    return [
        (tick, message) for tick in range(first, last) for message in operator.messages(tick, frame)
    ]


def pedals(messages):
    """(tick, pedal) of each change."""
    found = [(tick, message["pedal"]) for tick, message in messages if message["type"] == "input"]
    return [
        now for before, now in zip([(0, None), *found], found, strict=False) if now[1] != before[1]
    ]


@pytest.mark.parametrize(("cue_on", "alive", "expected"), [(1, 1, 750), (0, 1, None), (1, 0, None)])
def test_it_reacts_to_the_onset_of_what_it_feels_after_its_delay(cue_on, alive, expected):
    operator, _ = follower()
    frame = running()
    frame["cue_on"], frame["console_alive"] = cue_on, alive
    said(operator, frame, 0, 500)
    frame["gold/force"] = (0.0, 0.01, 0.0)
    changes = pedals(said(operator, frame, 500, 5000))[1:]
    if expected is None:
        assert changes == []
    else:  # the pull that stays is no news
        assert changes[0] == (expected, False) and changes[1][1]
        assert 0 <= changes[1][0] - 2250 < INPUT_EVERY_MS
        assert len(changes) == 2


def test_it_restarts_a_stopped_robot_and_steps_on_again():
    operator, _ = follower()
    frame = running()
    said(operator, frame, 0, 500)
    frame["phase"], frame["runlevel"] = PHASES.index("stopped"), 0
    messages = said(operator, frame, 500, 2001)
    assert [tick for tick, message in messages if message["type"] == "operator"] == [2000]
    lifted = [tick for tick, down in pedals(messages) if not down]
    assert len(lifted) == 1 and 900 <= lifted[0] < 900 + INPUT_EVERY_MS
    frame["phase"], frame["pedal"] = PHASES.index("ready"), 0
    assert [down for _, down in pedals(said(operator, frame, 2001, 3500))] == [False, True]


def line_of(arms, kind="input", **more):
    message = {"type": kind, "source": "test", "pedal": True, "arms": arms} | more
    return json.dumps({"tick": 1, "message": message})


@pytest.mark.parametrize(
    "line",
    [
        *("{", "[]", '{"tick": -1, "message": {}}', '{"tick": 1}', '{"tick": 1, "message": 3}'),
        *(line_of({}, pedal=1), line_of({"golden": {}}), line_of({"gold": {"move": [1, 2]}})),
        line_of({"gold": {"turn": "left"}}),
        line_of({"gold": {"delta_um": [1, 1, 10**400]}}, "increments"),
        line_of({"gold": {"delta_um": [1, 1, 1], "quat": [0, 0, 0, 0]}}, "increments"),
    ],
)
def test_a_line_that_is_no_message_is_told_with_its_number(tmp_path, line):
    path = tmp_path / "said.jsonl"
    path.write_text('{"tick": 0, "message": {}}\n\n' + line + "\n")
    with pytest.raises(UserError, match=r"said.jsonl:3: .* Expected"):
        read_commands(path)
    with pytest.raises(UserError, match="cannot be read"):
        read_commands(tmp_path / "none.jsonl")
