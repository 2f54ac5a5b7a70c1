"""One console drives, the others watch; a pedal counts after it was seen up."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.train.protocol.frame import CONSOLES
from ravenjax.train.protocol.messages import STALE_MS
from ravenjax.train.session.console_arbiter import GONE_MS, ConsoleArbiter


class Play:
    """A seat, its tick, and what of each console's messages reached the hands."""

    def __init__(self):
        self.arbiter, self.tick, self.events, self.reached = ConsoleArbiter(), 0, [], []

    def say(self, console, pedal, ms=0, good=True):
        """Whether the pedal counts as down; None where the message reached no hand."""
        self.tick += ms
        before = len(self.reached)
        take = lambda message: (self.reached.append(message), good)[1]  # noqa: E731
        self.arbiter.hear(
            {"type": "input", "console": console, "pedal": pedal, "arms": {}}, take, self.tick
        )
        self.arbiter.step(self.tick)
        self.events += self.arbiter.events()
        return self.reached[-1]["pedal"] if len(self.reached) > before else None

    def act(self, console, do, **more):
        changed = self.arbiter.obey(
            {"type": "seat", "console": console, "do": do, **more}, self.tick
        )
        self.events += self.arbiter.events()
        return changed

    def driving(self, console="page"):
        self.say(console, False)
        assert self.say(console, True)
        return self


def test_whoever_first_steps_on_the_pedal_drives_and_the_others_watch():
    play = Play()
    assert play.say("page", False) is False and play.say("itp", False) is False
    assert play.say("itp", True) is True and play.arbiter.owner == "itp"
    for _ in range(50):
        assert play.say("page", False, 40) is None  # a heartbeat lifts nobody's pedal
        assert play.say("page", True, 1) is None
        assert play.say("itp", True, 1) is True
    assert [event for event in play.events if event["kind"] == "owner"] == [
        {"tick": 0, "kind": "owner", "console": "itp", "by": "pedal"}
    ]


@pytest.mark.parametrize("by", ["silence", "left", "rearm"])
def test_a_pedal_that_stays_down_does_not_count_again_until_it_was_seen_up(by):
    play = Play().driving()
    if by == "left":
        play.act("page", "left")
    elif by == "rearm":
        play.arbiter.rearm("restart", play.tick)
    assert play.say("page", True, STALE_MS + 1 if by == "silence" else 1) is False
    assert play.say("page", True, 100) is False
    play.say("page", False, 100)
    assert play.say("page", True, 100) is True
    assert any(event["kind"] == "rearm" for event in play.events) or by == "left"


def test_the_other_takes_it_only_while_the_pedal_is_up_and_must_be_seen_up_first():
    play = Play().driving("itp")
    play.say("page", False)
    assert not play.act("page", "take") and play.arbiter.owner == "itp"
    assert play.events[-1]["kind"] == "refused" and "itp" in play.events[-1]["why"]
    play.say("itp", False, 10)
    assert play.act("page", "take")
    assert play.events[-1] == {"tick": 10, "kind": "owner", "console": "page", "by": "operator"}
    assert play.say("page", True, 10) is False  # it was up before it was given, not since
    assert play.say("itp", True, 10) is None


def test_who_has_it_gives_it_and_the_instructor_gives_it_to_anyone():
    play = Play().driving("page")
    assert not play.act("itp", "give", to="itp") and play.arbiter.owner == "page"
    assert play.act("page", "give", to="itp") and play.arbiter.owner == "itp"
    play.say("itp", False, 10)
    assert play.say("itp", True, 10)
    assert play.act("page", "give", to="page", by="instructor") and play.arbiter.owner == "page"
    assert play.say("itp", True, 10) is None
    assert play.events[-1]["by"] == "instructor"


def test_a_console_that_is_gone_leaves_the_seat_to_whoever_steps_on_a_pedal():
    play = Play().driving("page")
    play.tick += GONE_MS + 1
    assert play.arbiter.step(play.tick) and play.arbiter.owner == "nobody"
    assert play.say("page", True) is False
    play.say("itp", False)
    assert play.say("itp", True) and play.arbiter.owner == "itp"


ACTS = st.one_of(
    st.tuples(st.just("say"), st.sampled_from(CONSOLES[1:]), st.booleans(), st.integers(0, 400)),
    st.tuples(st.just("take"), st.sampled_from(CONSOLES[1:])),
    st.tuples(st.just("left"), st.sampled_from(CONSOLES[1:])),
    st.tuples(st.just("give"), st.sampled_from(CONSOLES[1:]), st.sampled_from(CONSOLES)),
    st.tuples(st.just("rearm")),
)


@given(st.lists(ACTS, max_size=60))
def test_no_foot_that_never_moved_drives_and_every_change_is_told(acts):
    play, told = Play(), "nobody"
    up_since = dict.fromkeys(
        CONSOLES, False
    )  # each console's pedal since it last had to be seen up
    for what, *rest in acts:
        before = play.arbiter.owner
        if what == "say":
            console, pedal, ms = rest
            heard = list(play.reached)
            if play.say(console, pedal, ms):
                assert up_since[console] and len(play.reached) == len(heard) + 1
                assert play.arbiter.owner == console
            up_since[console] = up_since[console] or not pedal
        elif what == "rearm":
            play.arbiter.rearm("test", play.tick)
            up_since = dict.fromkeys(CONSOLES, False)
        else:
            changed = play.act(rest[0], what, **({"to": rest[1]} if what == "give" else {}))
            if what == "left" or changed:
                up_since[rest[0] if what == "left" else play.arbiter.owner] = False
        if play.arbiter.owner != before:
            told = [event for event in play.events if event["kind"] == "owner"][-1]["console"]
        assert told == play.arbiter.owner
