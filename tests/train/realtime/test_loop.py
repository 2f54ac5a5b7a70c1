"""The realtime loop: commands from a ring, frames and events into rings."""

import pytest

from ravenjax.store.ring import COMMAND_BYTES, EVENT_BYTES, Ring, put_json, read_json
from ravenjax.train import scenario
from ravenjax.train.realtime import loop
from ravenjax.train.session.advance import Session

CHOSEN = scenario.from_dict(
    {"name": "tiny", "duration_s": 1.5, "task": {"kind": "reach", "targets": 50}}
)


class Mover:
    """Steps on the pedal and pushes to the right, sixty times a second."""

    def __init__(self, session):
        self.session = session

    def poll(self):
        if self.session.ticks % 16:
            return []
        hand = {"move": [1.0, 0.0, 0.0], "turn": [0.0, 0.0, 0.0], "grasp": 0.0}
        pedal = self.session.ticks > 50
        return [{"type": "input", "source": "keyboard", "pedal": pedal, "arms": {"gold": hand}}]

    def send_frame(self, frame):
        pass


@pytest.fixture(scope="module")
def blueprint():
    return Session(CHOSEN, 5).blueprint


@pytest.fixture
def rings():
    made = [
        Ring.create(4096, 4 * 256),
        Ring.create(1024, EVENT_BYTES),
        Ring.create(8, COMMAND_BYTES),
    ]
    yield made
    for ring in made:
        ring.close()


def test_the_inbox_hands_over_what_the_page_said(rings):
    ring = rings[2]
    inbox = loop.PageCommands(ring)
    assert inbox.poll() == []
    for number in range(3):
        put_json(ring, {"type": "operator", "do": "note", "text": f"ä{number}"})
    assert [command["text"] for command in inbox.poll()] == ["ä0", "ä1", "ä2"]
    assert inbox.poll() == []
    for number in range(20):
        put_json(ring, {"type": "operator", "do": "note", "text": str(number)})
    texts = [command["text"] for command in inbox.poll()]
    assert texts == [str(number) for number in range(20 - len(texts), 20)] and 0 < len(texts) < 8


def test_the_page_has_its_stamp_and_where_a_script_drives_no_hand_of_it_gets_through(rings):
    for drives in (True, False):
        inbox = loop.PageCommands(rings[2], drives)
        inbox.poll()
        hand = {"type": "input", "pedal": False, "arms": {}}
        for one in (hand, {"type": "seat", "do": "take"}, {"type": "operator", "do": "estop"}):
            put_json(rings[2], one)
        expected = [("input", "page"), ("seat", "page"), ("operator", None)]
        assert [(one["type"], one.get("console")) for one in inbox.poll()] == expected[
            0 if drives else 2 :
        ]


@pytest.mark.slow
def test_trouble_elsewhere_is_told_once(blueprint, rings):
    session = Session(CHOSEN, 5, ready=blueprint)
    frames, asked = Ring.create(4096, 4 * session.layout.size), []

    def trouble():
        asked.append(session.ticks)
        return "the disk is full"

    try:
        loop.run_loop(session, [Mover(session)], rings=(frames, rings[1]), find_failure=trouble)
    finally:
        frames.close()
    (one,) = (event for event in read_json(rings[1].read(0)[1]) if event["kind"] == "trouble")
    assert one["text"] == "the disk is full" and one["tick"] == 1000
    assert len(asked) == 1
