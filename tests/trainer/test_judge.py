"""The judge: times, responses, outcome and score of hazards in sessions that are made up tick by tick."""

from __future__ import annotations

import math

import pytest
from made_frames import kinds, made, running

from ravenjax.trainer.judge import COLUMNS, Judge
from ravenjax.trainer.judge.pace import SLOW_FOR_MS

FAULT = [{"site": "usb_out", "channel": "elbow", "effect": "offset", "value": 700, "duration_ms": 2000}]


class Play:
    """A session of frames: `run(ticks, channel=value, ...)` keeps what it is given."""

    def __init__(self, arms=("gold",), cue_on=True, scale=0.1, blinded=False, **entry):
        keys = {"name": "h", "fault": FAULT, "right_response": ["release"], "within_s": 1.0} | entry
        chosen, hazards = made(arms=list(arms), hazard=[keys], scale=scale, cue={"blinded": blinded})
        self.judge = Judge(chosen, hazards, cue_on)
        self.frame, self.tick = running(arms), 0
        self.frame["cue_on"] = cue_on
        self.events = []
        self.outcomes = {}
        self.speed = 0.0  # um of the hand in a ms

    def run(self, ticks=1, **channels):
        for name, value in channels.items():
            self.frame[name.replace("__", "/")] = value
        for _ in range(ticks):
            self.frame["tick"] = self.tick + 5000  # the robot was on before the session began
            self.frame["gold/hand"] = self.frame["gold/hand"] + (self.speed, 0, 0)
            outcomes = self.outcomes if self.tick % 10 == 0 and self.outcomes else None
            self.events += self.judge.step(self.tick, self.frame, outcomes)
            self.tick += 1
        return self

    def strike(self, **channels):
        self.events += self.judge.armed(0, self.tick)
        return self.run(1, fault_active=1, **channels)

    def say(self, **message):
        self.events += self.judge.command({"type": "operator", **message}, self.tick)
        return self

    def over(self):
        self.events += self.judge.disarmed(self.tick)
        return self.judge.rows(session="s", participant="p", group="g", seed=9)[-1]

    def of(self, kind):
        return [event for event in self.events if event["kind"] == kind]


def test_a_hazard_that_is_felt_and_answered():
    play = Play()
    play.run(1000).strike().run(19)
    play.run(80, gold__known_mm=0.01, gold__stray_mm=2.0, gold__error_mm=2.1)
    play.run(200, gold__force=(0.0, 0.013, 0.0), gold__stray_mm=4.0, gold__error_mm=4.5, gold__depth_mm=-3.0)
    play.run(600, pedal=0, runlevel=2, gold__stray_mm=3.9, gold__force=(0.0, 0.0, 0.0))
    row = play.over()
    assert list(row) == list(COLUMNS)
    assert row | {"title": ""} == {
        "session": "s",
        "participant": "p",
        "group": "g",
        "scenario": "made",
        "seed": 9,
        "cue": "on",
        "blinded": False,
        "number": 0,
        "hazard": "fault",
        "title": "",
        "arm": "gold",
        "armed_ms": 1000,
        "struck_ms": 1000,
        "knowable_ms": 1020,
        "knowable_by": "tip",
        "cue_ms": 1100,
        "alarm_ms": None,
        "alarm": None,
        "response": "release",
        "response_ms": 1300,
        "reaction_ms": 280,  # from the first possible knowledge
        "right_response": "release",
        "response_ok": True,
        "peak_error_mm": pytest.approx(4.5),
        "peak_stray_mm": pytest.approx(4.0),
        "deepest_mm": pytest.approx(-3.0),
        "stopped": False,
        "outcome": "avoided",
        "score": round(50 * (1 - 0.5 * 30 / 750) + 50 * (1 - 0.4), 1),
    }
    told = ["hazard_armed", "hazard_struck", "knowable", "cue", "stray", "response", "hazard_over"]
    assert kinds(play.events) == told
    assert play.of("response")[0] == {
        "tick": 1300, "kind": "response", "number": 0, "what": "release", "ok": True, "ms": 280,
    }  # fmt: skip
    assert play.of("stray")[0]["arm"] == "gold" and play.of("cue")[0]["number"] == 0


def test_knowledge_needs_more_than_the_resolution_of_the_measured_tip():
    play = Play()
    play.run(10).strike(gold__known_mm=math.sqrt(3) / 1e3).run(100)
    assert not play.of("knowable")
    assert play.run(1, gold__known_mm=0.0025).over()["knowable_ms"] == 111


def test_without_the_cue_nothing_is_felt_and_the_reaction_has_the_same_origin():
    rows = []
    for cue_on in (True, False):
        play = Play(cue_on=cue_on)
        play.run(10).strike(gold__known_mm=1.0).run(100, gold__force=(0.1, 0, 0), gold__stray_mm=5.0)
        rows.append(play.run(100, pedal=0, runlevel=2).over())
        assert bool(play.of("cue")) is cue_on  # a cue that nobody feels is not told either: it would tell of the group
    assert [row["cue"] for row in rows] == ["on", "off"] and [row["cue_ms"] for row in rows] == [11, None]
    assert rows[0]["reaction_ms"] == rows[1]["reaction_ms"] == 101


def test_a_dead_console_is_no_response_and_feels_nothing():
    play = Play()
    play.run(10).strike(gold__known_mm=1.0, gold__stray_mm=2.0)
    play.run(10, console_alive=0, pedal=0, runlevel=2, gold__force=(0.1, 0, 0))
    row = play.over()
    assert row["response"] is None and row["cue_ms"] is None and row["outcome"] == "missed"


def test_a_response_before_anything_can_be_known_is_none():
    play = Play()
    play.run(10).strike().run(10, pedal=0, runlevel=2).run(10, pedal=1, runlevel=3)
    assert not play.of("response")
    assert play.run(5, gold__known_mm=1.0).run(5, pedal=0, runlevel=2).over()["response_ms"] == 36


def test_a_right_response_that_comes_too_late_is_not_ok():
    play = Play(within_s=0.5)
    play.run(10).strike(gold__known_mm=1.0, gold__stray_mm=2.0).run(510).run(10, pedal=0, runlevel=2)
    row = play.over()
    assert (row["response"], row["response_ok"], row["outcome"]) == ("release", False, "missed")
    assert play.of("response")[0]["ok"] is False and row["score"] == 40.0


@pytest.mark.parametrize(
    ("channels", "outcome", "score"),
    [
        ({"gold__stray_mm": 10.0}, "harm", 50.0),  # the right response cannot mend it
        ({"gold__stray_mm": 6.0, "gold__depth_mm": 7.0}, "harm", 50.0),
        ({"gold__stray_mm": 4.0, "gold__depth_mm": 7.0}, "avoided", 60.0),  # driven 4 of 5 mm: no deeper than astray
        ({"gold__stray_mm": 4.0, "gold__depth_mm": 3.0}, "avoided", 80.0),  # 1 mm deeper than before; 4 of 10 astray
    ],
)
def test_harm_is_what_the_fault_did(channels, outcome, score):
    play = Play()
    play.run(10, gold__depth_mm=2.0).strike(gold__known_mm=1.0).run(50, **channels)
    row = play.run(10, pedal=0, runlevel=2).over()
    assert row["outcome"] == outcome and row["response_ok"]
    assert row["score"] == {50.0: 50.0, 60.0: 60.0, 80.0: 80.0}[score]


def test_depth_counts_while_the_robot_is_live_alone():
    play = Play()
    play.run(10).strike(gold__known_mm=1.0, gold__depth_mm=-5.0)
    play.run(10, runlevel=2, pedal=0, gold__depth_mm=9.0, gold__stray_mm=8.0)
    row = play.over()
    assert row["deepest_mm"] == -5.0 and row["outcome"] == "avoided"


def test_a_robot_that_stops_itself_is_stopped_and_a_late_foot_is_no_response():
    play = Play()
    play.run(10).strike(gold__known_mm=1.0, gold__stray_mm=2.0).run(50)
    play.run(300, runlevel=0, soft_estopped=1).run(100, pedal=0)
    row = play.over()
    assert row["stopped"] and row["outcome"] == "stopped" and row["response"] is None


def test_a_robot_that_stops_in_the_very_tick_of_the_strike_is_stopped_too():
    play = Play()
    play.run(10).strike(runlevel=0, soft_estopped=1)
    row = play.over()
    assert row["stopped"] and (row["knowable_ms"], row["knowable_by"]) == (10, "runlevel")


def test_a_robot_that_stands_does_not_stray_when_its_twin_goes_on():
    play = Play()
    play.run(10).strike(gold__known_mm=1.0, gold__stray_mm=2.0).run(50)
    x, y, z = play.frame["gold/tip"].tolist()
    play.run(300, runlevel=0, soft_estopped=1, gold__stray_mm=30.0)
    play.run(10, gold__tip=(x, y + 0.0015, z), gold__stray_mm=31.0)  # its brakes slip by 1.5 mm
    row = play.over()
    assert row["peak_stray_mm"] == pytest.approx(3.5, abs=1e-3) and row["outcome"] == "stopped"


def test_going_on_is_no_answer_to_a_robot_that_stopped():
    play = Play(right_response=["continue"])
    row = play.run(10).strike(gold__known_mm=1.0).run(50).run(10, runlevel=0).over()
    assert row["outcome"] == "stopped" and not row["response_ok"]


def test_a_pedal_up_that_the_robot_makes_up_is_a_stop():
    play = Play(right_response=["restart"])
    play.run(10).strike().run(5, runlevel=2)
    assert play.over()["stopped"]


def test_the_operators_e_stop_is_a_response_and_no_stop_of_the_robots_own():
    play = Play(right_response=["stop", "convert"])
    play.run(10).strike(gold__known_mm=1.0, gold__stray_mm=2.0).run(100).say(do="estop").run(50, runlevel=0)
    row = play.over()
    assert (row["response"], row["response_ms"], row["response_ok"]) == ("stop", 111, True)
    assert not row["stopped"] and row["outcome"] == "avoided"


def test_a_note_that_says_convert_is_a_conversion():
    play = Play(right_response=["convert"])
    play.run(10).strike(gold__known_mm=1.0).say(do="note", text="odd").run(10).say(do="note", text="Converted now")
    assert play.over()["response"] == "convert"


def test_a_restart_counts_once_the_robot_no_longer_follows_and_ends_the_hazard():
    play = Play(right_response=["restart"], within_s=5)
    play.run(10).strike(gold__known_mm=1.0).say(do="restart")
    assert not play.of("response")
    play.run(100, runlevel=2).say(do="restart")
    play.events += play.judge.restarted(play.tick)
    (row,) = play.judge.rows()
    assert (row["response"], row["outcome"]) == ("restart", "avoided") and row["stopped"]
    assert kinds(play.events)[-2:] == ["response", "hazard_over"]
    assert play.of("hazard_over")[0]["outcome"] == "avoided"


@pytest.mark.parametrize(("lifted", "outcome"), [(False, "avoided"), (True, "missed")])
def test_going_on_is_right_where_nothing_else_is(lifted, outcome):
    play = Play(right_response=["continue"])
    play.run(10).strike(gold__known_mm=1.0, gold__stray_mm=1.5).run(500)
    play.run(100, pedal=int(not lifted), runlevel=2 if lifted else 3)
    row = play.over()
    assert row["outcome"] == outcome and row["response"] == ("release" if lifted else "continue")
    assert (row["reaction_ms"] is None) is not lifted


def slowed(ticks, share, right):
    play = Play(right_response=right, within_s=2.0)
    play.speed = 200.0  # um a ms before scaling: 20 mm/s
    play.run(8000).strike(gold__known_mm=1.0, gold__stray_mm=2.0).run(400)
    play.speed *= share
    play.run(ticks)
    play.speed = 200.0
    play.run(100)
    return play.over()


def test_slowing_down_counts_from_its_beginning_if_it_lasts():
    row = slowed(SLOW_FOR_MS + 300, 0.1, ["slow", "release"])
    assert row["response"] == "slow" and row["response_ok"]
    assert 401 < row["reaction_ms"] < 550  # when the running mean has come down
    assert slowed(SLOW_FOR_MS - 300, 0.1, ["slow"])["response"] is None  # as at a target
    assert slowed(SLOW_FOR_MS + 300, 0.5, ["slow"])["response"] is None
    assert slowed(SLOW_FOR_MS + 300, 0.1, ["release"])["response"] is None  # not asked for


def test_hands_that_stood_when_it_struck_have_not_slowed_down():
    play = Play(right_response=["slow"])
    play.run(3000).strike(gold__known_mm=1.0).run(3000)
    assert play.over()["response"] is None


def test_alarms_are_those_that_tripped_since_and_the_first_trip_is_exact():
    play = Play()
    play.outcomes = {"check_ik_reject_count": 3, "check_ik_reject_first_ms": 4000, "check_estop_count": 0}
    play.outcomes["check_estop_first_ms"] = -1
    play.run(100).strike().run(20)
    assert [event["check"] for event in play.of("alarm")] == ["ik_reject"]  # before the hazard
    play.outcomes = play.outcomes | {"check_estop_count": 1, "check_estop_first_ms": 5000 + 123}
    row = play.run(20).over()
    assert (row["alarm"], row["alarm_ms"]) == ("estop", 123)
    assert (row["knowable_by"], row["knowable_ms"]) == ("estop", 123)


def test_a_check_that_keeps_tripping_is_told_once():
    play = Play()
    for count in range(100):
        play.outcomes = {"check_joint_limit_count": count, "check_joint_limit_first_ms": 5000}
        play.run(10)
    assert len(play.of("alarm")) == 1


def test_a_force_about_its_threshold_is_one_cue():
    play = Play()
    for _ in range(20):
        play.run(20, gold__force=(0.1, 0, 0)).run(20, gold__force=(0, 0, 0))
    play.run(400).run(5, gold__force=(0.1, 0, 0))
    assert [(event["tick"], event["number"]) for event in play.of("cue")] == [(0, -1), (1200, -1)]


def test_a_hazard_without_effect_and_answer_is_not_scored():
    play = Play()
    row = play.run(10).strike(gold__known_mm=0.5, gold__stray_mm=0.9).run(500).over()
    assert row["outcome"] == "unaffected" and row["score"] is None and row["response_ok"] is False


def test_a_hazard_that_never_struck_has_a_row():
    play = Play()
    play.events += play.judge.armed(0, 0)
    row = play.run(10).over()
    assert row["armed_ms"] == 0 and row["struck_ms"] is None and row["peak_stray_mm"] is None
    assert row["outcome"] == "unaffected" and row["deepest_mm"] is None


def test_the_arm_of_a_fault_on_no_arm_is_the_one_that_strays():
    fault = [{"site": "console", "channel": "scale", "effect": "scale", "value": 2}]
    play = Play(arms=("gold", "green"), fault=fault)
    row = play.run(5).strike(green__stray_mm=1.5, gold__stray_mm=0.2, gold__known_mm=0.1).over()
    assert row["arm"] == "green" and row["peak_stray_mm"] == 1.5


def test_the_summary_counts_what_became_of_all():
    play = Play()
    play.run(10).strike(gold__known_mm=1.0, gold__stray_mm=4.0).run(99).run(10, pedal=0, runlevel=2).over()
    play.run(100, pedal=1, runlevel=3, fault_active=0, gold__known_mm=0.0, gold__stray_mm=0.0)
    play.strike(gold__known_mm=1.0, gold__stray_mm=20.0).run(10)
    play.events += play.judge.close(play.tick)
    summary = play.judge.result()
    assert summary == {
        "hazards": 2, "struck": 2, "outcomes": {"avoided": 1, "harm": 1}, "right_responses": 1,
        "median_reaction_ms": 100, "score": 40.0,
    }  # fmt: skip


def test_the_judge_says_nothing_of_a_session_in_which_nothing_happens():
    play = Play().run(3000)
    assert play.events == [] and play.judge.rows() == []
    assert play.judge.result()["score"] is None
