"""The judge: times, responses, outcome and score of hazards in sessions that are made up tick by
tick.
"""

import pytest
from made_frames import FAULT, kinds, made, running

from ravenjax.train.judge import COLUMNS, SLOW_FOR_MS, Judge


class Play:
    """A session of frames: `run(ticks, channel=value, ...)` keeps what it is given."""

    def __init__(
        self, arms=("gold",), cue_on=True, scale=0.1, blinded=False, limit_mm=10.0, **entry
    ):
        keys = {"name": "h", "fault": FAULT, "right_response": ["release"], "within_s": 1.0} | entry
        harm = {"excursion_mm": limit_mm}
        chosen, hazards = made(
            arms=list(arms), hazard=[keys], scale=scale, cue={"blinded": blinded}, harm=harm
        )
        self.judge = Judge(chosen, hazards, cue_on, self.record)
        self.frame, self.tick = running(arms), 0
        self.frame["cue_on"] = cue_on
        self.events = []
        self.outcomes, self.golden = {}, {}
        self.speed = 0.0  # um of the hand in a ms
        self.off_mm = dict.fromkeys(arms, 0.0)

    def record(self, kind, **facts):
        self.events.append({"tick": self.tick, "kind": kind, **facts})

    def run(self, ticks=1, **channels):
        """ARM__off_mm: unintended motion of the tip, in the channel of a live robot or in that
        of one that is not.
        """
        for name, value in channels.items():
            if name.endswith("__off_mm"):
                self.off_mm[name.partition("__")[0]] = value
            else:
                self.frame[name.replace("__", "/")] = value
        live = self.frame.number("runlevel") == 3 and not self.frame.number("soft_estopped")
        self.frame["live"] = live
        for arm, off_mm in self.off_mm.items():
            self.frame[f"{arm}/unintended_mm"] = off_mm * live
            self.frame[f"{arm}/unintended_off_mm"] = off_mm * (not live)
        for _ in range(ticks):
            self.frame["tick"] = self.tick + 5000  # the robot was on before the session began
            self.frame["gold/hand"] = self.frame["gold/hand"] + (self.speed, 0, 0)
            outcomes = self.outcomes if self.tick % 10 == 0 and self.outcomes else None
            self.judge.step(self.tick, self.frame, outcomes, self.golden or None)
            self.tick += 1
        return self

    def strike(self, **channels):
        self.judge.begin_hazard(0, self.tick)
        return self.run(1, fault_active=1, **channels)

    def say(self, **message):
        self.judge.record_command({"type": "operator", **message}, self.tick)
        return self

    def over(self):
        self.judge.end_hazard()
        return self.judge.rows(session="s", participant="p", group="g", seed=9)[-1]

    def of(self, kind):
        return [event for event in self.events if event["kind"] == kind]


def test_a_hazard_that_is_felt_and_answered():
    play = Play()
    play.run(1000).strike().run(19)
    play.run(80, gold__known_mm=0.01, gold__off_mm=2.0, gold__error_mm=2.1)
    felt = {"gold__force": (0.0, 0.013, 0.0), "gold__error_mm": 4.5}
    play.run(200, gold__off_mm=4.0, gold__depth_mm=-3.0, **felt)
    play.run(600, pedal=0, runlevel=2, gold__off_mm=3.9, gold__force=(0.0, 0.0, 0.0))
    row = play.over()
    assert list(row) == list(COLUMNS)
    expected = {
        "struck_ms": 1000,
        "knowable_ms": 1020,
        "knowable_by": "tip",
        "cue_ms": 1100,
        "check_response": "silent",
        "motion_hazard": "none",  # the limit is 10 mm
        "unintended_mm": pytest.approx(4.0),
        "unintended_off_mm": pytest.approx(3.9),
        "peak_error_mm": pytest.approx(4.5),
        "deepest_mm": pytest.approx(-3.0),
        "response": "release",
        "reaction_ms": 280,  # from the first possible knowledge
        "response_ok": True,
        "outcome": "avoided",
        # 4 mm were gone before anyone could have acted
        "score": round(50 * (1 - 0.5 * 30 / 750) + 50, 1),
    }
    assert {name: row[name] for name in expected} == expected
    order = "hazard_armed hazard_struck knowable cue response hazard_over hazard_row"
    assert kinds(play.events) == order.split()
    (response,) = play.of("response")
    assert (response["tick"], response["what"], response["ok"]) == (1300, "release", True)


@pytest.mark.parametrize("channel", ["gold__known_mm", "gold__off_mm", "gold__loss_mm"])
def test_a_person_knows_of_a_millimetre_and_not_of_what_a_computer_could_tell(channel):
    play = Play()
    play.run(10).strike(**{channel: 0.002}).run(50).run(50, **{channel: 0.99})
    assert not play.of("knowable")
    row = play.run(1, **{channel: 1.0}).over()
    assert (row["knowable_ms"], row["knowable_by"]) == (111, "tip")


def test_what_comes_after_a_person_could_have_acted_counts_on_what_was_left():
    play = Play()
    play.run(1000).strike(gold__off_mm=4.0).run(149).run(
        10, gold__off_mm=7.0
    )  # half of the 6 mm that were left
    row = play.run(10, pedal=0, runlevel=2).over()
    assert (row["outcome"], row["score"]) == ("avoided", 75.0)


def test_a_dead_console_is_no_response_and_feels_nothing():
    play = Play()
    play.run(10).strike(gold__known_mm=1.0, gold__off_mm=2.0)
    play.run(10, console_alive=0, pedal=0, runlevel=2, gold__force=(0.1, 0, 0))
    row = play.over()
    assert row["response"] is None and row["cue_ms"] is None
    # It is not the operator's that a console dies.
    assert (row["outcome"], row["score"]) == ("interrupted", None)
    assert [(event["number"], event["by"]) for event in play.of("interrupted")] == [(0, "console")]


@pytest.mark.parametrize(
    ("channels", "outcome", "score"),
    [
        ({"gold__off_mm": 10.01}, "harm", 50.0),  # the right response cannot mend it
        ({"gold__off_mm": 10.0}, "avoided", 50.0),  # the limit itself is not over the limit
        ({"gold__off_mm": 6.0, "gold__depth_mm": 7.01}, "harm", 50.0),
        # driven 4 of 5 mm: no deeper than it moved
        ({"gold__off_mm": 4.0, "gold__depth_mm": 7.0}, "avoided", 60.0),
        # 1 mm deeper than before; 4 of 10 moved
        ({"gold__off_mm": 4.0, "gold__depth_mm": 3.0}, "avoided", 80.0),
    ],
)
def test_harm_is_what_the_fault_did(channels, outcome, score):
    play = Play()
    play.run(10, gold__depth_mm=2.0).strike(gold__known_mm=1.0).run(160).run(50, **channels)
    row = play.run(10, pedal=0, runlevel=2).over()
    assert row["outcome"] == outcome and row["response_ok"]
    assert row["score"] == score


def test_a_note_that_says_convert_is_a_conversion():
    play = Play(right_response=["convert"])
    play.run(10).strike(gold__known_mm=1.0).say(do="note", text="odd").run(10).say(
        do="note", text="Converted now"
    )
    assert play.over()["response"] == "convert"


def test_a_restart_counts_once_the_robot_no_longer_follows_and_ends_the_hazard():
    play = Play(right_response=["restart"], within_s=5)
    play.run(10).strike(gold__known_mm=1.0).say(do="restart")
    assert not play.of("response")
    play.run(100, runlevel=2).say(do="restart")
    play.judge.restart()
    (row,) = play.judge.rows()
    assert (row["response"], row["outcome"]) == ("restart", "avoided") and row["halted"]
    assert kinds(play.events)[-3:] == ["response", "hazard_over", "hazard_row"]
    assert play.of("hazard_over")[0]["outcome"] == "avoided"


@pytest.mark.parametrize(("lifted", "outcome"), [(False, "avoided"), (True, "missed")])
def test_going_on_is_right_where_nothing_else_is(lifted, outcome):
    play = Play(right_response=["continue"])
    play.run(10).strike(gold__known_mm=1.0, gold__off_mm=1.5).run(500)
    play.run(100, pedal=int(not lifted), runlevel=2 if lifted else 3)
    row = play.over()
    assert row["outcome"] == outcome and row["response"] == ("release" if lifted else "continue")
    assert (row["reaction_ms"] is None) is not lifted


def slowed(ticks, share, right):
    play = Play(right_response=right, within_s=2.0)
    play.speed = 200.0  # um a ms before scaling: 20 mm/s
    play.run(8000).strike(gold__known_mm=1.0, gold__off_mm=2.0).run(400)
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


def test_a_limit_is_told_to_nobody_and_kept_as_such():
    play = Play()
    play.outcomes = {"check_overdrive_clip_count": 0, "check_overdrive_clip_first_ms": -1}
    play.run(100).strike()
    play.outcomes = {"check_overdrive_clip_count": 7, "check_overdrive_clip_first_ms": 5000 + 105}
    play.run(20).run(200, pedal=0, runlevel=2)
    row = play.over()
    told = row["limited"], row["limited_ms"], row["check_response"]
    assert told == ("overdrive_clip", 105, "limited")
    assert row["alarm"] is None and row["alarm_ms"] is None and row["knowable_ms"] is None
    assert row["response"] is None  # nobody could know: a foot that came up then is no response
    assert play.of("alarm") == [] and play.of("knowable") == []
    assert play.of("limited") == [
        {"tick": 110, "kind": "limited", "number": 0, "check": "overdrive_clip", "ms": 105}
    ]


def test_a_check_that_keeps_tripping_is_told_once_with_its_count():
    play = Play().run(10)
    for count in range(1, 13309, 7):
        play.outcomes = {"check_joint_limit_count": count, "check_joint_limit_first_ms": 5010}
        play.run(10)
    play.judge.close(play.tick)
    alarms, counts = play.of("alarm"), [event["count"] for event in play.of("alarm_count")]
    assert [alarm["check"] for alarm in alarms] == ["joint_limit"]
    assert counts[-1] == count > 13_000 and counts == sorted(counts)
    assert len(counts) <= 1 + play.tick / 1000
