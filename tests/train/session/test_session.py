"""A session is a function of scenario, seed and commands: who drives, who rests, who is stopped;
without a clock.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from ravenjax.train import protocol, scenario
from ravenjax.train.session import advance, scripts
from ravenjax.train.session.advance import Session

BURST = {"site": "usb_out", "effect": "overwrite", "start_ms": 0}
CHOSEN = scenario.from_dict(
    {
        "name": "short",
        "duration_s": 12,
        "scale": 0.1,
        "task": {"kind": "reach", "targets": 100, "tolerance_mm": 2.5, "dwell_ms": 100},
        "hazard": [
            {
                "name": "burst",
                "when": [3, 3],
                "within_s": 1.5,
                "right_response": ["release"],
                "fault": [BURST | {"channel": "shoulder", "value": 6000, "duration_ms": 40}],
            },
            {
                "name": "other",
                "when": "instructor",
                "fault": [BURST | {"channel": "elbow", "value": -6000, "duration_ms": 20}],
            },
        ],
    }
)


@pytest.fixture(scope="module")
def made():
    return Session(CHOSEN, 5).blueprint


@pytest.fixture
def session(made):
    return Session(CHOSEN, 5, ready=made)


def hand(pedal=True, move=(0.0, 0.0, 0.0)):
    arms = {"gold": {"move": list(move)}}
    return {"type": "input", "source": "test", "pedal": pedal, "arms": arms}


def drive(session, ticks, *, pedal=True, move=(0.0, 0.0, 0.0), also=()):
    """So many ticks with the same hand; rows and events."""
    rows, events = [], []
    for k in range(ticks):
        commands = [hand(pedal and session.ticks > 0, move)] if k % 20 == 0 else []  # seen up first
        events += session.tick([*commands, *(also if k == 0 else ())])
        rows.append(session.frame.row.copy())
    return np.array(rows), events


def started(session):
    drive(session, 800)
    assert session.frame.number("runlevel") == 3
    return session


def whole(session, operator):
    rows, events = [], []
    while not session.over:
        events += session.tick(operator.messages(session.ticks, session.frame))
        rows.append(session.frame.row.copy())
    return np.array(rows), events, session.judge.rows()


def channel(session, rows, name):
    return rows[:, session.layout.places[name]]


def test_a_session_comes_again_to_the_bit_from_what_was_said(made, tmp_path):
    first = Session(CHOSEN, 5, ready=made)
    operator = scripts.Follower(first.task, first.arms, CHOSEN.speeds, "release")
    rows, events, hazards = whole(first, operator)
    (tmp_path / "commands.jsonl").write_text("".join(first.command_lines))
    second = Session(CHOSEN, 5, ready=made)
    again = scripts.Scripted(str(tmp_path / "commands.jsonl"), second)
    other, told, table = whole(second, SimpleNamespace(messages=lambda *_: again.poll()))
    np.testing.assert_array_equal(rows, other)
    assert (events, hazards) == (told, table)
    kinds = [event["kind"] for event in events]
    told = "phase pedal runlevel target hazard_armed hazard_struck knowable cue response"
    assert set(told.split()) <= set(kinds)
    assert kinds[-1] == "end" and len(rows) == first.started + 12_000
    (row,) = hazards
    assert row["response"] == "release" and row["response_ok"]
    times = [row[f"{name}_ms"] for name in ("armed", "struck", "knowable", "cue", "response")]
    assert times == sorted(times)


def test_without_a_living_console_the_pedal_is_up_and_nothing_moves(session):
    started(session)
    rows, _ = drive(session, 50, move=(0.5, 0.0, 0.0))
    silent = np.array([(session.tick([]), session.frame.row.copy())[1] for _ in range(1500)])
    assert not channel(session, silent, "console_alive")[-1]
    assert not channel(session, silent, "pedal")[-1]
    assert channel(session, silent, "runlevel")[-1] == 2  # pedal up, as the robot sees it
    tips = channel(session, silent, "gold/tip")
    assert np.linalg.norm(tips[-1] - tips[-300]) < 1e-4
    assert channel(session, rows, "console_alive").all()


def test_the_estop_button_stops_and_a_restart_begins_anew(session):
    started(session)
    drive(session, 600, move=(1.0, 0.0, 0.0))
    _, events = drive(session, 400, also=[{"type": "operator", "do": "estop"}])
    assert session.frame.number("runlevel") == 0
    assert {"phase": "stopped"}.items() <= next(e for e in events if e["kind"] == "phase").items()
    _, events = drive(session, 5, pedal=False, also=[{"type": "operator", "do": "restart"}])
    start = session.blueprint.plan.motion.start_jpos[0]
    assert session.frame.number("runlevel") == 2
    np.testing.assert_allclose(session.frame["gold/link_jpos"], start, atol=1e-3)
    drive(session, 20, pedal=False)
    assert started(session).frame.number("phase") == 1


def test_a_pause_stops_time_and_releases_what_was_held(session):
    started(session)
    drive(session, 100, move=(1.0, 0.0, 0.0))
    before, ticks = session.frame.row.copy(), session.ticks
    drive(session, 300, also=[{"type": "instructor", "do": "pause"}])
    assert session.ticks == ticks
    places = session.layout.places
    np.testing.assert_array_equal(session.frame["gold/tip"], before[places["gold/tip"]])
    # Only the instructor ends the pause.
    session.tick([{"type": "operator", "do": "restart"}])
    assert session.phase == protocol.PAUSED
    session.tick([{"type": "instructor", "do": "resume"}])
    assert session.frame.number("pedal") == 0 and session.ticks == ticks + 1


def test_after_an_estop_there_is_no_force_and_the_model_stands_where_the_robot_was_stopped(session):
    started(session)
    drive(session, 300, move=(1.0, 0.0, 0.0))
    rows, events = drive(
        session, 6000, move=(1.0, 0.0, 0.0), also=[{"type": "operator", "do": "estop"}]
    )
    after = channel(session, rows, "runlevel").ravel() == 0
    # The foot stays where it is.
    assert after.sum() > 5900 and channel(session, rows, "pedal").all()
    assert not channel(session, rows, "gold/force")[after].any()
    assert np.ptp(channel(session, rows, "gold/model_tip")[after], axis=0).max() == 0.0
    assert channel(session, rows, "gold/error_mm")[after].max() < 3.0
    assert not [event for event in events if event["kind"] == "cue"]
    drive(session, 5, pedal=False, also=[{"type": "operator", "do": "restart"}])
    drive(session, 200, pedal=False)
    began = session.frame["gold/model_tip"].copy()
    drive(session, 1500, move=(0.3, 0.0, 0.0))
    # It goes with the robot again.
    assert np.linalg.norm(session.frame["gold/model_tip"] - began) > 5e-3


def moved_mm(session, ticks, **how):
    before = session.frame["gold/tip"].copy()
    drive(session, ticks, **how)
    return 1e3 * float(np.linalg.norm(session.frame["gold/tip"] - before))


@pytest.mark.parametrize("why", ["silence", "restart", "reset", "resume", "reconnection"])
def test_a_pedal_that_is_still_down_drives_nothing_until_it_was_seen_up(session, why):
    started(session)
    assert moved_mm(session, 300, move=(1.0, 0.0, 0.0)) > 3.0
    if why == "silence":
        for _ in range(300):
            session.tick([])
    elif why == "restart":
        drive(session, 400, also=[{"type": "operator", "do": "estop"}])
        session.tick([{"type": "operator", "do": "restart"}])
    elif why == "reset":
        session.tick([{"type": "instructor", "do": "reset"}])
    elif why == "resume":
        session.tick([{"type": "instructor", "do": "pause"}])
        session.tick([{"type": "instructor", "do": "resume"}])
    else:
        session.tick([{"type": "seat", "do": "left"}])
    drive(session, 200)
    assert moved_mm(session, 600, move=(1.0, 0.0, 0.0)) < 0.1 and session.frame.number("pedal") == 0
    drive(session, 20, pedal=False)
    drive(session, 200)
    assert moved_mm(session, 300, move=(1.0, 0.0, 0.0)) > 3.0


def test_the_time_of_a_session_begins_with_the_first_pedal_down(session, monkeypatch):
    monkeypatch.setattr(advance, "STAND_BY_MS", 1000)
    # Longer than the session, and than a robot waits.
    rows, events = drive(session, 13_000, pedal=False)
    assert not session.over and not [event for event in events if event["kind"] == "hazard_armed"]
    assert set(channel(session, rows, "left_ms").ravel()) == {12_000.0}
    rows, events = drive(session, 12_100)
    (began,) = [event["tick"] for event in events if event["kind"] == "started"]
    (armed,) = [event["tick"] for event in events if event["kind"] == "hazard_armed"]
    assert armed - began >= 3000  # as the scenario has it
    assert session.ended == "time" and session.ticks - began == 12_000
    left = channel(session, rows, "left_ms").ravel()
    assert left[0] == 12_000 and left[-1] == 0 and (np.diff(left) <= 0).all()


def struck(session):
    """A hazard that keeps on, at work."""
    started(session)
    drive(session, 5, also=[{"type": "instructor", "do": "arm", "hazard": 1}])
    assert [row["struck_ms"] for row in session.judge.rows()] != [None]
    drive(session, 100)
    return session


@pytest.mark.parametrize(
    "act",
    [
        [{"type": "instructor", "do": "pause"}, {"type": "instructor", "do": "resume"}],
        [{"type": "instructor", "do": "disarm"}],
        [{"type": "instructor", "do": "reset"}],
        [{"type": "instructor", "do": "end"}],
        [{"type": "operator", "do": "estop", "by": "instructor"}],
        [{"type": "operator", "do": "estop", "by": "watcher"}],
        [{"type": "seat", "do": "give", "to": "page", "by": "instructor"}],
    ],
    ids=lambda act: " ".join(one.get("by", "") + one["do"] for one in act),
)
def test_what_is_not_the_trainees_never_scores(session, act):
    struck(session)
    for command in act:
        session.tick([command])
    drive(session, 900)
    (row,) = session.judge.rows()
    assert (row["response"], row["outcome"], row["score"]) == (None, "interrupted", None)


@pytest.mark.parametrize(
    "act",
    [
        {"do": "left"},
        {"do": "give", "to": "nobody"},
        {"do": "give", "to": "itp"},
        {"type": "operator", "do": "rehearse"},
    ],
    ids=str,
)
@pytest.mark.parametrize("pedal", [True, False])
def test_who_leaves_or_lets_the_robot_rest_has_lifted_the_pedal_and_voids_nothing(
    session, act, pedal
):
    struck(session)
    if not pedal:
        drive(session, 20, pedal=False)
    events = session.tick([{"type": "seat", **act}])
    for _ in range(3000):  # longer than a console that is silent keeps the seat
        events += session.tick([])
    (row,) = session.judge.rows()[:1]
    assert row["response"] == "release" and row["outcome"] != "interrupted" and not row["halted"]
    assert not [event for event in events if event["kind"] == "interrupted"]


def test_what_is_tried_on_the_virtual_robot_the_robot_then_does(session):
    started(session)
    say = lambda do: {"type": "operator", "do": do}  # noqa: E731
    drive(session, 800, pedal=False, also=[say("rehearse")])
    tried, _ = drive(session, 700, move=(0.6, 0.2, 0.0))
    assert session.frame.number("view") == 1
    rest, virtual = channel(session, tried, "gold/tip"), channel(session, tried, "gold/virtual_tip")
    assert np.ptp(rest, axis=0).max() < 1e-3 and np.linalg.norm(virtual[-1] - virtual[0]) > 5e-3
    assert channel(session, tried, "runlevel")[-1] == 2  # disengaged: pedal up

    drive(session, 300, pedal=False, also=[say("reengage")])
    held = session.frame["gold/tip"].copy()
    assert session.frame.number("view") == 2
    np.testing.assert_allclose(held, rest[-1], atol=1e-3)  # a lifted pedal holds the replay back

    followed, _ = drive(session, 1100)  # without the idle time of the trial
    assert session.frame.number("view") == 0
    end = channel(session, followed, "gold/tip")[-1]
    np.testing.assert_allclose(end, virtual[-1], atol=1.5e-3)
    before = session.frame["gold/tip"].copy()
    drive(session, 50)
    # The hand goes on from there without a jump.
    assert np.linalg.norm(session.frame["gold/tip"] - before) < 2e-4


def test_alarms_of_the_virtual_robot_are_told_during_a_trial(session):
    started(session)
    trial = {"type": "operator", "do": "rehearse"}
    _, events = drive(session, 3500, move=(0.0, 1.0, 0.0), also=[trial])
    alarms = [event for event in events if event["kind"] == "alarm"]
    assert alarms and all(alarm["virtual"] for alarm in alarms)
    assert session.frame.number("view") == 1 and session.frame.number("runlevel") == 2


def test_the_instructor_arms_switches_the_cue_and_ends(session):
    started(session)
    arm = {"type": "instructor", "do": "arm", "hazard": 1}
    rows, events = drive(session, 200, also=[arm, {"type": "instructor", "do": "cue", "on": False}])
    assert [e["number"] for e in events if e["kind"] == "hazard_struck"] == [1]
    assert channel(session, rows, "fault_active").sum() == 20
    assert not channel(session, rows, "cue_on")[1:].any()
    _, events = drive(session, 2, also=[{"type": "instructor", "do": "end"}])
    assert session.over and session.ended == "instructor"
    assert [e["reason"] for e in events if e["kind"] == "end"] == ["instructor"]
