"""Before a session's time begins its robot may wait for as long as it likes, stopped or not
heard of too.
"""

import numpy as np
import pytest

from ravenjax.train import scenario
from ravenjax.train.protocol.frame import PHASES
from ravenjax.train.session import advance
from ravenjax.train.session.advance import Session

CHOSEN = scenario.from_dict({"name": "waits", "duration_s": 2, "task": {"kind": "free"}})
ESTOP = {"type": "operator", "do": "estop", "by": "watcher"}


@pytest.fixture
def session():
    return Session(CHOSEN, 0)


def wait(session, ticks, *, pedal=False, also=()):
    """So many ticks; what happened."""
    hand = {"type": "input", "pedal": pedal, "arms": {}}
    return [
        event
        for k in range(ticks)
        for event in session.tick([*([hand] if k % 20 == 0 else []), *(also if k == 0 else ())])
    ]


def test_a_robot_that_is_stopped_before_anybody_drove_waits_stopped_for_as_long_as_it_takes(
    session, monkeypatch
):
    monkeypatch.setattr(advance, "STAND_BY_MS", 300)
    wait(session, 100)
    wait(session, 500, also=[ESTOP])
    tips = session.frame["gold/tip"].copy()
    wait(session, 2000)
    assert session.robot.now <= 300
    assert PHASES[int(session.frame.number("phase"))] == "stopped"
    assert session.frame.number("runlevel") == 0
    np.testing.assert_allclose(session.frame["gold/tip"], tips, atol=1e-4)
    wait(session, 100, also=[{"type": "operator", "do": "restart"}])
    events = wait(session, 3000, pedal=True)
    assert [event["by"] for event in events if event["kind"] == "started"] == ["pedal"]
    assert session.ended == "time"
