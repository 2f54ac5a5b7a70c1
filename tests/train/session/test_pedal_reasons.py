"""Why a pedal that is held down over the network does not count: told once, in words, at each
change.
"""

from types import SimpleNamespace

import pytest

from ravenjax.train import scenario
from ravenjax.train.protocol import STALE_MS, VIEWS
from ravenjax.train.robot_link.itp import TAKEN, Gate, ItpConsole
from ravenjax.train.session import simulation
from ravenjax.train.session.advance import Session
from ravenjax.train.session.console_arbiter import REASONS, packets_message

CHOSEN = scenario.from_dict({"name": "pedal", "arms": ["gold"], "duration_s": 60})


@pytest.fixture(scope="module")
def ready():
    return simulation.make_blueprint(
        scenario.session_campaign(CHOSEN, 0), limit_mm=CHOSEN.harm.excursion_mm
    )


class Told:
    """A session, and what was told of the console's pedal."""

    def __init__(self, ready):
        self.session, self.lines, self.whys = Session(CHOSEN, 0, ready=ready), [], []
        self.session.pedals.say = self.lines.append

    def run(self, down, ms, *commands, console="itp"):
        """Hold the pedal so for a while; None: nothing comes. The reasons that were told
        meanwhile.
        """
        before = len(self.whys)
        for tick in range(ms):
            hands = {"type": "input", "console": console, "pedal": down, "arms": {}}
            said = [*(commands if tick == 0 else ()), *([] if down is None else [hands])]
            self.whys += [one["why"] for one in self.session.tick(said) if one["kind"] == "refused"]
        return self.whys[before:]


@pytest.fixture
def told(ready):
    return Told(ready)


def instructor(do):
    return {"type": "instructor", "do": do}


def test_each_change_of_the_reason_is_told_once(told):
    assert told.run(True, 600) == [f"itp: {REASONS['lift']}"]  # down from the beginning
    assert told.run(False, 100) == [""]  # nothing is wrong any more
    assert told.run(True, 300) == [] and told.session.frame.number("pedal") == 1
    assert told.lines == [f"itp: {REASONS['lift']}"]
    assert told.run(None, STALE_MS + 200) == [f"itp: {REASONS['silent']}"]
    assert told.run(True, 100) == [f"itp: {REASONS['lift']} (the console was silent)"]
    told.run(False, 100)
    assert told.run(True, 100) == []
    assert told.run(True, 100, instructor("pause")) == [f"itp: {REASONS['paused']}"]
    assert told.run(True, 100, instructor("resume")) == [
        f"itp: {REASONS['lift']} (the session was paused)"
    ]
    told.run(False, 100)
    assert told.run(True, 100) == []
    assert told.run(True, 200, {"type": "operator", "do": "estop"}) == [
        f"itp: {REASONS['stopped']}"
    ]
    again = told.run(True, 200, {"type": "operator", "do": "restart"})
    assert again[-1] == f"itp: {REASONS['lift']} (the robot was restarted)"


def test_two_short_presses_begin_a_trial_and_have_it_repeated(told):
    def press(*times):
        for down, ms in times:
            told.run(down, ms)
        return VIEWS[int(told.session.frame.number("view"))]

    taps = [(False, 900), (True, 100), (False, 100), (True, 100), (False, 10)]
    assert press((False, 100), (True, 1000), (False, 100), (True, 1000), (False, 10)) == "real"
    assert press(*taps) == "virtual"
    assert press((True, 1000)) == "virtual" and press(*taps) == "replay"
    assert press((True, 4000)) == "real", "the robot has repeated the motion"


def test_packets_that_are_refused_are_told_and_that_they_are_taken_again(told):
    gate = Gate(("gold",))
    console = ItpConsole(SimpleNamespace(gate=gate, poll=list), None)

    def commands(**counts):
        for cause, count in counts.items():
            gate.counts[cause] += count
        return [one for _ in range(STALE_MS) for one in console.poll()]

    why = packets_message("behind")
    said = {"type": "unheard", "console": "itp", "why": why}
    assert commands(behind=50) == [said] and commands(behind=50) == []
    assert told.run(None, 100, said) == [f"itp: {why}"]
    assert commands(**{TAKEN: 50, "step": 1}) == [{**said, "why": ""}]
    assert told.run(None, 100, {**said, "why": ""}) == [""]
    assert "another console" in commands(**{TAKEN: 50, "stranger": 50})[0]["why"]
    assert commands(step=3) == [], "a few are no reason"
