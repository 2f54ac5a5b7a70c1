"""Measures of motion against closed forms: lines and circles, the minimum-jerk profile, a
Gaussian's spectrum.
"""

import math

import numpy as np
import pytest
import synthetic_session as synthetic
from scipy import integrate, optimize

from ravenjax.stats import motion
from ravenjax.store.logs.session import description
from ravenjax.store.logs.session import log as session_log
from ravenjax.train.debrief import dexterity, figures, page
from ravenjax.train.protocol import FrameLayout
from ravenjax.train.recording import reader

LAYOUT = FrameLayout.of(("gold", "green"))


def session(gold, green, pedal=None, target=None):
    """A course whose tips go along these points [T, 3], m, one a millisecond."""
    rows = np.zeros((len(gold), LAYOUT.size), np.float32)
    ms = np.arange(len(gold))
    for name, values in (
        ("session_tick", ms),
        ("phase", 1),
        ("gold/tip", gold),
        ("green/tip", green),
    ):
        rows[:, LAYOUT.places[name]] = (
            values[:, None] if getattr(values, "ndim", 0) == 1 else values
        )
    rows[:, LAYOUT.places["pedal"]] = (np.ones(len(gold)) if pedal is None else pedal)[:, None]
    rows[:, LAYOUT.places["target"]] = (np.full(len(gold), -1) if target is None else target)[
        :, None
    ]

    log = session_log.SessionLog({}, LAYOUT.names(), ms, rows, [], True, 0)
    return reader.Recording(**vars(log), layout=LAYOUT).without_pauses()


def minimum_jerk(seconds, rate=1000):
    """From 0 to 1 (Flash and Hogan 1985)."""
    t = np.linspace(0, 1, round(seconds * rate) + 1)
    return 10 * t**3 - 15 * t**4 + 6 * t**5


def test_a_circle_and_a_line_have_their_lengths_and_economies():
    turn = np.linspace(0, 2 * np.pi, 20_001)[:, None]
    circle = np.hstack([np.cos(turn), np.sin(turn), 0 * turn]) * 0.02
    assert motion.path_length(circle) == pytest.approx(2 * np.pi * 0.02, rel=1e-6)
    half = circle[:10_001]
    assert motion.path_economy([half]) == pytest.approx(2 / np.pi, rel=1e-6)
    assert motion.path_economy([half[:1].repeat(3, axis=0)]) is None
    assert motion.path_economy([np.linspace(half[0], half[-1], 50), half]) == pytest.approx(
        4 / (2 + np.pi), rel=1e-6
    )


@pytest.mark.parametrize(("seconds", "distance"), [(0.8, 0.05), (3.0, 0.2)])
def test_a_minimum_jerk_movement_has_its_jerk_whatever_its_size(seconds, distance):
    rate = 1000
    t = np.linspace(0, 1, round(seconds * rate) + 1)
    profile = distance / seconds * 30 * (t**2 - 2 * t**3 + t**4)
    # the integral of the jerk squared is 720 D^2/T^5, the peak 15/8 D/T
    assert motion.log_dimensionless_jerk(profile, rate) == pytest.approx(
        -math.log(720 / (15 / 8) ** 2), abs=0.01
    )


def test_a_gaussian_speed_has_the_arc_length_of_its_spectrum():
    sigma, rate = 0.12, 1000.0
    t = np.arange(-2, 2, 1 / rate)
    profile = np.exp(-(t**2) / (2 * sigma**2))
    spectrum = lambda f: math.exp(-2 * (math.pi * sigma * f) ** 2)  # noqa: E731
    last = optimize.brentq(lambda f: spectrum(f) - 0.05, 0.1, 10)
    slope = lambda f: -4 * (math.pi * sigma) ** 2 * f * spectrum(f)  # noqa: E731
    length, _ = integrate.quad(lambda f: math.hypot(1 / last, slope(f)), 0, last)
    assert motion.spectral_arc_length(profile, rate) == pytest.approx(-length, rel=0.01)
    two = profile + np.roll(profile, 900)
    assert motion.spectral_arc_length(two, rate) < motion.spectral_arc_length(profile, rate)
    assert motion.spectral_arc_length(0 * profile, rate) is None


def test_a_session_of_known_motion_has_its_measures():
    there = minimum_jerk(1.0)[:, None] * [0.03, 0.04, 0.0]  # 50 mm, then 2 s of rest, and back
    rest, back = np.repeat(there[-1:], 2000, axis=0), there[::-1]
    gold = np.concatenate([there, rest, back])
    green = np.concatenate([there, rest, np.repeat(there[-1:], len(back), axis=0)])
    target = np.where(np.arange(len(gold)) < 2000, 0, 1)
    told = dexterity.measure_dexterity(session(gold, green, target=target))
    gold, green = told["arms"].values()
    assert told["driven_s"] == pytest.approx(4.002) and gold["movements"] == 2
    assert gold["path_mm"] == pytest.approx(100, rel=0.01)
    assert green["path_mm"] == pytest.approx(50, rel=0.01)
    assert gold["economy"] == pytest.approx(1.0, abs=0.01)
    assert told["idle"] == pytest.approx(0.5, abs=0.05)
    assert told["both"] == pytest.approx(0.25, abs=0.03)


def test_what_is_done_with_the_pedal_up_counts_for_nothing():
    way = np.linspace([0, 0, 0], [0.1, 0, 0], 4000)
    pedal = (np.arange(4000) < 1000).astype(float)
    told = dexterity.measure_dexterity(session(way, way, pedal))
    assert told["driven_s"] == pytest.approx(1.0)
    assert told["arms"]["gold"]["path_mm"] == pytest.approx(25, rel=0.02)
    none = dexterity.measure_dexterity(session(way, way, 0 * pedal))
    assert none["driven_s"] == 0 and none["idle"] is None and none["arms"]["gold"]["sparc"] is None


def attempt(base, name, day, **header):
    folder = synthetic.write(
        base / name, [], recorded=False, started=f"2026-01-{day:02}T00:00:00.000+00:00", **header
    )
    arms = {arm: {"path_mm": 10.0 * day, "sparc": -5.0 + day} for arm in ("gold", "green")}
    told = {
        "dexterity": {"idle": 0.5, "arms": arms},
        "hazards": {"score": 5 * day, "median_reaction_ms": None},
    }
    description.update_session(folder, {"summary": told})
    return folder


def test_a_curve_holds_the_persons_sessions_of_the_scenario_so_far_in_order(tmp_path):
    third = attempt(tmp_path, "a", 3)
    attempt(tmp_path, "b", 1)
    attempt(tmp_path, "c", 2, participant="P2")
    attempt(tmp_path, "d", 2, scenario={"name": "other"})
    attempt(tmp_path, "e", 4)
    told = dexterity.read_attempts(third)
    assert [one["name"] for one in told] == ["b", "a"]
    drawn = figures.learning_charts(told)
    # No reaction was timed.
    assert [chart.marks[0].y.tolist() for chart in drawn] == [[5, 15], [20.0, 60.0], [-4.0, -2.0]]
    assert figures.learning_charts(told[:1]) == []
    assert dexterity.read_attempts(attempt(tmp_path, "f", 1, participant="")) == []


def test_the_debrief_keeps_and_shows_the_measures_of_a_recording(tmp_path):
    attempt(tmp_path, "first", 1, participant="P1")
    folder = synthetic.write(tmp_path / "second", [], seconds=4.0)
    text = page.write_debrief(folder).read_text()
    told = description.read_session(folder)["summary"]["dexterity"]
    assert told["driven_s"] == pytest.approx(3.6) and told["both"] > 0.9
    phase = np.arange(400, 4000) / 700
    way = np.stack(
        [0.02 * np.sin(phase), 0.015 * np.cos(phase), -0.1 + 0.004 * np.sin(2.3 * phase)], axis=1
    )
    path_mm = told["arms"]["gold"]["path_mm"]
    assert path_mm == pytest.approx(1e3 * motion.path_length(way), rel=0.02)
    assert f"{path_mm:.1f} mm" in text and "Balasubramanian" in text and "learning-1" in text
