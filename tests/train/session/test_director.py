"""When hazards are let loose and taken back."""

import pytest
from made_frames import made, running

from ravenjax.train.protocol import PHASES, VIEWS
from ravenjax.train.session.advance import CLEARED_MS, GAP_MS, SETTLED_MS, Director

FAULT = [
    {"site": "usb_out", "channel": "elbow", "effect": "offset", "value": 700, "duration_ms": 100}
]


def hazard(name, **keys):
    return {"name": name, "fault": FAULT, "right_response": ["release"], "within_s": 1.0, **keys}


def director(*entries, seed=0):
    _, armable = made(hazard=list(entries))
    return Director(armable, seed)


def run(one, frame, first, last):
    """(tick, order) of each order."""
    return [(tick, order) for tick in range(first, last) for order in one.step(tick, frame, tick)]


def test_a_hazard_strikes_when_due_and_is_taken_back_after_its_time():
    one = director(hazard("a", when=2))
    frame = running()
    assert run(one, frame, 0, 2000) == []
    (armed,) = run(one, frame, 2000, 2001)
    assert armed == (2000, ("arm", 0)) and one.hazard_number == 0
    # The response's time and half a second.
    assert run(one, frame, 2001, 10_000) == [(3500, ("disarm", 0))]
    assert one.hazard_number == -1


@pytest.mark.parametrize(
    ("channel", "value"),
    [
        ("phase", PHASES.index("stopped")),
        ("phase", PHASES.index("ready")),
        ("view", VIEWS.index("virtual")),
        ("pedal", 0),
        ("console_alive", 0),
        ("runlevel", 2),
        ("soft_estopped", 1),
    ],
)
def test_nothing_strikes_while_it_could_teach_nothing(channel, value):
    one = director(hazard("a", when=1))
    frame, idle = running(), running()
    idle[channel] = value
    assert run(one, idle, 0, 4000) == []
    assert run(one, frame, 4000, 9000)[0] == (4000 + SETTLED_MS - 1, ("arm", 0))


def test_one_at_a_time_with_a_gap_between():
    one = director(hazard("a", when=1), hazard("b", when=1.01), hazard("c", when=1.02))
    orders = run(one, running(), 0, 20_000)
    assert [order for _, order in orders] == [
        (kind, n) for n in range(3) for kind in ("arm", "disarm")
    ]
    armed, taken = [tick for tick, _ in orders[::2]], [tick for tick, _ in orders[1::2]]
    assert [a - t for a, t in zip(armed[1:], taken, strict=False)] == [GAP_MS, GAP_MS]


def test_lifting_the_pedal_mends_what_it_is_right_for():
    lifted = running()
    lifted["pedal"] = 0
    one = director(hazard("a", when=1), hazard("b", when=4, right_response=["slow"], within_s=2))
    run(one, running(), 0, 1100)
    assert run(one, lifted, 1100, 1100 + CLEARED_MS) == [(1099 + CLEARED_MS, ("disarm", 0))]
    assert run(one, running(), 2000, 5000)[0][1] == ("arm", 1)
    # Lifting the pedal is not right for this one: it stays.
    assert run(one, lifted, 5000, 6000) == []
    assert run(one, lifted, 6000, 9000)[0][1] == ("disarm", 1)


def test_the_instructor_arms_any_hazard_and_takes_it_back():
    one = director(hazard("a"), hazard("b"), hazard("c", when=3))
    frame, lifted = running(), running()
    lifted["pedal"] = 0
    run(one, frame, 0, 1000)
    one.command({"do": "arm", "hazard": 1})
    assert (
        run(one, lifted, 1000, 2000) == [] and one.hazard_number == 1
    )  # armed, and waits for the pedal
    assert run(one, frame, 2000, 3000) == [(1999 + SETTLED_MS, ("arm", 1))]
    one.command({"do": "arm", "hazard": 0})  # one at a time
    one.command({"do": "disarm"})
    assert run(one, frame, 3000, 3001) == [(3000, ("disarm", 1))]
    assert run(one, frame, 3001, 8000)[0] == (3000 + GAP_MS, ("arm", 2))  # the plan goes on
