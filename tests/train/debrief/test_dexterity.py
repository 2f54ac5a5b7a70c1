"""Measures of motion against closed forms: lines and circles, the minimum-jerk profile, a
Gaussian's spectrum.
"""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import synthetic_session as synthetic
from scipy import integrate, optimize

from ravenjax.train.debrief import dexterity
from ravenjax.train.debrief.course import Course
from ravenjax.train.protocol.frame import FrameLayout

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

    class Made(SimpleNamespace):
        def __getitem__(self, name):
            return self.rows[:, LAYOUT.places[name]][:, 0]

    return Course(Made(rows=rows, layout=LAYOUT))


def minimum_jerk(seconds, rate=1000):
    """From 0 to 1 (Flash and Hogan 1985)."""
    t = np.linspace(0, 1, round(seconds * rate) + 1)
    return 10 * t**3 - 15 * t**4 + 6 * t**5


def test_a_circle_and_a_line_have_their_lengths_and_economies():
    turn = np.linspace(0, 2 * np.pi, 20_001)[:, None]
    circle = np.hstack([np.cos(turn), np.sin(turn), 0 * turn]) * 0.02
    assert dexterity.path_length(circle) == pytest.approx(2 * np.pi * 0.02, rel=1e-6)
    half = circle[:10_001]
    assert dexterity.economy([half]) == pytest.approx(2 / np.pi, rel=1e-6)
    assert math.isnan(dexterity.economy([half[:1].repeat(3, axis=0)]))
    assert dexterity.economy([np.linspace(half[0], half[-1], 50), half]) == pytest.approx(
        4 / (2 + np.pi), rel=1e-6
    )


@pytest.mark.parametrize(("seconds", "distance"), [(0.8, 0.05), (3.0, 0.2)])
def test_a_minimum_jerk_movement_has_its_jerk_whatever_its_size(seconds, distance):
    rate = 1000
    t = np.linspace(0, 1, round(seconds * rate) + 1)
    profile = distance / seconds * 30 * (t**2 - 2 * t**3 + t**4)
    # the integral of the jerk squared is 720 D^2/T^5, the peak 15/8 D/T
    assert dexterity.log_dimensionless_jerk(profile, rate) == pytest.approx(
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
    assert dexterity.spectral_arc_length(profile, rate) == pytest.approx(-length, rel=0.01)
    two = profile + np.roll(profile, 900)
    assert dexterity.spectral_arc_length(two, rate) < dexterity.spectral_arc_length(profile, rate)
    assert math.isnan(dexterity.spectral_arc_length(0 * profile, rate))


def test_a_session_of_known_motion_has_its_measures():
    there = minimum_jerk(1.0)[:, None] * [0.03, 0.04, 0.0]  # 50 mm, then 2 s of rest, and back
    rest, back = np.repeat(there[-1:], 2000, axis=0), there[::-1]
    gold = np.concatenate([there, rest, back])
    green = np.concatenate([there, rest, np.repeat(there[-1:], len(back), axis=0)])
    target = np.where(np.arange(len(gold)) < 2000, 0, 1)
    told = dexterity.measure(session(gold, green, target=target))
    assert told.driven_s == pytest.approx(4.002)
    assert told.arms["gold"].path_mm == pytest.approx(100, rel=0.01)
    assert told.arms["green"].path_mm == pytest.approx(50, rel=0.01)
    assert (
        told.arms["gold"].economy == pytest.approx(1.0, abs=0.01)
        and told.arms["gold"].movements == 2
    )
    assert told.idle == pytest.approx(0.5, abs=0.05) and told.both == pytest.approx(0.25, abs=0.03)
    assert told.plain()["arms"]["gold"]["path_mm"] == told.arms["gold"].path_mm


def test_what_is_done_with_the_pedal_up_counts_for_nothing():
    way = np.linspace([0, 0, 0], [0.1, 0, 0], 4000)
    pedal = (np.arange(4000) < 1000).astype(float)
    told = dexterity.measure(session(way, way, pedal))
    assert told.driven_s == pytest.approx(1.0) and told.arms["gold"].path_mm == pytest.approx(
        25, rel=0.02
    )
    none = dexterity.measure(session(way, way, 0 * pedal)).plain()
    assert none["driven_s"] == 0 and none["idle"] is None and none["arms"]["gold"]["sparc"] is None


def test_speeds_that_rise_and_fall_together_are_correlated():
    t = np.arange(0, 6, 0.01)
    one = 1 + np.sin(t)
    assert dexterity.correlation(one, 3 * one + 2) == pytest.approx(1.0)
    assert dexterity.correlation(one, 1 - np.sin(t)) == pytest.approx(-1.0)
    assert math.isnan(dexterity.correlation(one, 0 * one))


def test_a_recorded_session_is_measured(tmp_path):
    from ravenjax.train.recording import reader

    folder = synthetic.write(tmp_path / "s", [], seconds=4.0)
    told = dexterity.measure(Course(reader.read(folder)))
    assert told.driven_s == pytest.approx(3.6) and told.both > 0.9
    phase = np.arange(400, 4000) / 700
    way = np.stack(
        [0.02 * np.sin(phase), 0.015 * np.cos(phase), -0.1 + 0.004 * np.sin(2.3 * phase)], axis=1
    )
    assert told.arms["gold"].path_mm == pytest.approx(1e3 * dexterity.path_length(way), rel=0.02)
