"""The study of mechanics: statics by hand and by robot, words of its tables."""

from __future__ import annotations

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


@pytest.mark.parametrize(
    ("band", "words"),
    [
        ((13.0, 9.6, 16.5), "statics"),
        ((1.2, 0.5, 2.0), "authors"),
        ((6.0, 0.0, 20.0), "statics and authors"),
        ((-15.0, -24.0, -9.0), "neither"),
    ],
)
def test_a_band_agrees_with_the_laws_inside_it(band, words) -> None:
    assert mechanics._agreement(band) == words


@pytest.mark.slow
def test_without_the_recordings_it_says_what_is_missing(monkeypatch) -> None:
    monkeypatch.delenv(mechanics.DATA, raising=False)
    findings = mechanics.compare(Context({}))
    assert not findings.lines and len(findings.tables) == 1
    assert mechanics.SEVEN_JOINTS in findings.notes[0] and mechanics.DATA in findings.notes[0]


@pytest.mark.slow
def test_the_first_jaw_of_the_arm_of_2018_is_strung_like_its_second(shared_data) -> None:
    """With raven2's opposed jaw its replay has nothing in common with the recording."""
    import numpy as np

    from ravenjax.analyses.calibration import position_loop
    from ravenjax.analyses.calibration.calibrate import LoggedRobot
    from ravenjax.robots.raven2.plant import robot as plant
    from ravenjax.robots.raven2.setup import RavenSetup

    logged = mechanics.seven_joints(shared_data(mechanics.SEVEN_JOINTS))
    part = logged.log.compared(2000, 10000)
    correlation = []
    for software in ("fork2015", "raven2"):
        setup = RavenSetup(software=software, arms=("gold",), tools=("r_grasper",))
        params = position_loop.params(plant.params(setup, "gold", "power_consistent"))
        (joints,) = LoggedRobot(part, setup, "gold", position_loop.RAVEN2).replayed(part, [params])
        rows = ~np.isnan(part.measured[:, 5])
        desired = part.desired[part.cycles][rows, 5]
        correlation.append(
            np.corrcoef(joints[rows, 5] - desired, part.measured[rows, 5] - desired)[0, 1]
        )
    assert correlation[0] > 0.9 and abs(correlation[1]) < 0.3
