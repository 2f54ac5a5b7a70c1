"""A session is a function of scenario, seed and commands: who drives, who rests, who is stopped; without a clock."""

import numpy as np
import pytest
from recording_operator import RecordingOperator

from ravenjax.trainer import scenario
from ravenjax.trainer.session import scripts
from ravenjax.trainer.session.advance import Session
from ravenjax.trainer.session.simulation import SimulatedRobot

CHOSEN = scenario.from_dict(
    {
        "name": "short",
        "duration_s": 12,
        "scale": 0.1,
        "task": {"kind": "reach", "targets": 100, "tolerance_mm": 2.5, "dwell_ms": 100},
        "hazard": [
            {"name": "burst", "when": [3, 3], "within_s": 1.5, "right_response": ["release"],
             "fault": [{"site": "usb_out", "channel": "shoulder", "effect": "overwrite", "value": 6000,
                        "start_ms": 0, "duration_ms": 40}]},
            {"name": "other", "when": "instructor",
             "fault": [{"site": "usb_out", "channel": "elbow", "effect": "overwrite", "value": -6000,
                        "start_ms": 0, "duration_ms": 20}]},
        ],
    }
)  # fmt: skip


@pytest.fixture(scope="module")
def made():
    return Session(CHOSEN, 5).blueprint


@pytest.fixture
def session(made):
    return Session(CHOSEN, 5, ready=made)


def hand(pedal=True, move=(0.0, 0.0, 0.0)):
    return {"type": "input", "source": "test", "pedal": pedal, "arms": {"gold": {"move": list(move)}}}


def drive(session, ticks, *, pedal=True, move=(0.0, 0.0, 0.0), also=()):
    """So many ticks with the same hand; rows and events."""
    rows, events = [], []
    for k in range(ticks):
        commands = [hand(pedal, move)] if k % 20 == 0 else []
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


def follower(session, **settings):
    return scripts.Follower(session.task, session.arms, CHOSEN.speeds, **settings)


def test_a_session_comes_again_to_the_bit_from_its_script_and_from_what_was_said(made):
    first = Session(CHOSEN, 5, ready=made)
    heard = RecordingOperator(follower(first))
    rows, events, hazards = whole(first, heard)
    for operator in (None, scripts.Recorded(heard.said)):
        again = Session(CHOSEN, 5, ready=made)
        other, told, table = whole(again, operator or follower(again))
        np.testing.assert_array_equal(rows, other)
        assert (events, hazards) == (told, table)
    kinds = [event["kind"] for event in events]
    for kind in (
        "phase",
        "pedal",
        "runlevel",
        "target",
        "hazard_armed",
        "hazard_struck",
        "knowable",
        "cue",
        "response",
    ):
        assert kind in kinds, kind
    assert kinds[-1] == "end" and len(rows) == 12_000
    (row,) = hazards
    assert row["response"] == "release" and row["response_ok"]
    assert row["armed_ms"] <= row["struck_ms"] <= row["knowable_ms"] <= row["cue_ms"] < row["response_ms"]


def test_without_a_living_console_the_pedal_is_up_and_nothing_moves(session):
    started(session)
    rows, _ = drive(session, 50, move=(0.5, 0.0, 0.0))
    silent = np.array([(session.tick([]), session.frame.row.copy())[1] for _ in range(1500)])
    assert channel(session, silent, "console_alive")[-1] == 0 and channel(session, silent, "pedal")[-1] == 0
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
    assert started(session).frame.number("phase") == 1


def test_a_pause_stops_time_and_releases_what_was_held(session):
    started(session)
    drive(session, 100, move=(1.0, 0.0, 0.0))
    before, ticks = session.frame.row.copy(), session.ticks
    drive(session, 300, also=[{"type": "instructor", "do": "pause"}])
    assert session.ticks == ticks
    places = session.layout.places
    np.testing.assert_array_equal(session.frame["gold/tip"], before[places["gold/tip"]])
    session.tick([{"type": "instructor", "do": "resume"}])
    assert session.frame.number("pedal") == 0 and session.ticks == ticks + 1


def test_what_is_tried_on_the_virtual_robot_the_robot_then_does(session):
    started(session)
    say = lambda do: {"type": "operator", "do": do}  # noqa: E731
    tried, _ = drive(session, 700, move=(0.6, 0.2, 0.0), also=[say("rehearse")])
    assert session.frame.number("view") == 1
    rest, virtual = channel(session, tried, "gold/tip"), channel(session, tried, "gold/virtual_tip")
    assert np.ptp(rest, axis=0).max() < 1e-3 and np.linalg.norm(virtual[-1] - virtual[0]) > 5e-3
    assert channel(session, tried, "runlevel")[-1] == 2  # disengaged: pedal up

    drive(session, 300, pedal=False, also=[say("reengage")])
    held = session.frame["gold/tip"].copy()
    assert session.frame.number("view") == 2
    np.testing.assert_allclose(held, rest[-1], atol=1e-3)  # a lifted pedal holds the replay back

    followed, _ = drive(session, 2000)
    assert session.frame.number("view") == 0
    end = channel(session, followed, "gold/tip")[-1]
    np.testing.assert_allclose(end, virtual[-1], atol=1.5e-3)
    before = session.frame["gold/tip"].copy()
    drive(session, 50)
    assert np.linalg.norm(session.frame["gold/tip"] - before) < 2e-4  # the hand goes on from there without a jump


def test_what_is_tried_can_be_left_alone(session):
    started(session)
    rest = session.frame["gold/tip"].copy()
    drive(session, 500, move=(0.6, 0.0, 0.0), also=[{"type": "operator", "do": "rehearse"}])
    drive(session, 800, also=[{"type": "operator", "do": "discard"}])
    assert session.frame.number("view") == 0
    np.testing.assert_allclose(session.frame["gold/tip"], rest, atol=1e-3)


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


class Tripping(SimulatedRobot):
    """A robot one of whose checks trips in its tick `at`, without the fault it would not; until it is disarmed."""

    at = 10**9

    def step(self):
        super().step()
        self.row[self.blueprint.layout.places["trips"]] += self.now > self.at

    def outcomes(self):
        tripped = self.now > self.at
        return super().outcomes() | {"check_ik_reject_count": int(tripped), "check_ik_reject_first_ms": self.at}

    def golden_outcomes(self):
        return self.outcomes() | ({"check_ik_reject_count": 0} if self._apart else {})


@pytest.mark.parametrize("end", ["disarm", "reset", "end"])
def test_a_check_that_trips_in_the_last_tick_of_a_hazard_is_of_that_hazard(made, end):
    session = started(Session(CHOSEN, 5, ready=made, robot=Tripping))
    drive(session, 205, also=[{"type": "instructor", "do": "arm", "hazard": 1}])
    session.robot.at, at_ms = session.robot.now, session.ticks
    session._looked = session.ticks  # the checks were looked at just now, and not again for some ticks
    drive(session, 1)
    (row,) = session.judge.rows()
    assert row["struck_ms"] is not None and row["alarm"] is None
    drive(session, 1, also=[{"type": "instructor", "do": end}])
    (row,) = session.judge.rows()
    assert (row["alarm"], row["alarm_ms"], row["check_response"]) == ("ik_reject", at_ms, "flagged")


def test_a_command_that_is_none_changes_nothing(made):
    quiet, pestered = Session(CHOSEN, 5, ready=made), Session(CHOSEN, 5, ready=made)
    nonsense = [
        {},
        {"type": "operator", "do": "fly"},
        {"type": ["input"]},
        {"type": "input", "pedal": "yes"},
        {"type": "input", "pedal": True, "arms": {"gold": {"move": [9e9, None, 1]}}},
        {"type": "instructor", "do": "arm", "hazard": 99},
    ]
    one, _ = drive(quiet, 900)
    other, _ = drive(pestered, 900, also=nonsense)
    np.testing.assert_array_equal(one, other)
