"""One console drives, the others watch; a pedal counts after it was seen up."""

from ravenjax.train.session.console_arbiter import ConsoleArbiter


class Play:
    """A seat, its tick, and what of each console's messages reached the hands."""

    def __init__(self):
        self.tick, self.events, self.reached = 0, [], []
        self.arbiter = ConsoleArbiter(
            lambda kind, **what: self.events.append({"tick": self.tick, "kind": kind, **what})
        )

    def say(self, console, pedal, ms=0, good=True):
        """Whether the pedal counts as down; None where the message reached no hand."""
        self.tick += ms
        before = len(self.reached)
        take = lambda message: (self.reached.append(message), good)[1]  # noqa: E731
        self.arbiter.receive(
            {"type": "input", "console": console, "pedal": pedal, "arms": {}}, take, self.tick
        )
        self.arbiter.step(self.tick)
        return self.reached[-1]["pedal"] if len(self.reached) > before else None

    def act(self, console, do, **more):
        return self.arbiter.change_seat(
            {"type": "seat", "console": console, "do": do, **more}, self.tick
        )

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
