"""The study of mechanics: statics by hand and by robot, words of its tables."""

import jax
import pytest

from studies import mechanics
from studies.study import Context


def test_statics_by_hand_are_those_of_motor_gear_and_drum() -> None:
    hand = mechanics.by_hand()
    assert hand.tension == pytest.approx(10000 / 2730 * 0.0603 * 12.25 / 5.675e-3)
    assert hand.torque == pytest.approx(hand.tension * 63.095e-3)
    assert hand.speed == pytest.approx(796.0, abs=0.1)


@pytest.mark.slow
def test_the_power_consistent_robot_gives_way_as_statics_say() -> None:
    with jax.enable_x64(True):
        ours = mechanics.of_robot("power_consistent")
    hand = mechanics.by_hand()
    assert ours.given_way == pytest.approx(hand.given_way, rel=0.1)
    assert ours.tension == pytest.approx(hand.tension, rel=0.05)
    assert ours.speed < hand.speed


@pytest.mark.slow
def test_without_the_recordings_it_says_what_is_missing(monkeypatch) -> None:
    monkeypatch.delenv(mechanics.DATA, raising=False)
    findings = mechanics.compare(Context({}))
    assert not findings.lines and len(findings.tables) == 1
    assert mechanics.SEVEN_JOINTS in findings.notes[0] and mechanics.DATA in findings.notes[0]
