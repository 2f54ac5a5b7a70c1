"""Incidence with censoring, against hand computation and simulation with a known law."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.stats.latency import incidence


def test_textbook_product():
    # deaths at 1, 3, 4; one leaves at 2: survival 4/5, then x 2/3, then x 1/2 with 5 at risk, 3, 2
    curve = incidence(np.array([1, 2, 3, 4, 5]), np.array([True, False, True, True, False]))
    at = dict(zip(curve.time, curve.fraction, strict=True))
    assert at[1] == pytest.approx(1 - 4 / 5)
    assert at[3] == pytest.approx(1 - 4 / 5 * 2 / 3)
    assert at[4] == pytest.approx(1 - 4 / 5 * 2 / 3 * 1 / 2)
    assert (curve.events, curve.n) == (3, 5)


def test_without_censoring_it_is_the_share():
    delay = np.random.default_rng(0).exponential(50, 400)
    curve = incidence(delay, np.ones(400, bool))
    assert np.interp(60, curve.time, curve.fraction) == pytest.approx(np.mean(delay <= 60), abs=0.005)
    assert curve.quantile(0.5) == pytest.approx(np.median(delay), rel=0.05)


def test_censoring_does_not_bias():
    random = np.random.default_rng(1)
    delay, end = random.exponential(50, 20_000), random.uniform(0, 150, 20_000)
    curve = incidence(np.minimum(delay, end), delay <= end)
    for time in (20, 50, 100):
        assert np.interp(time, curve.time, curve.fraction) == pytest.approx(1 - np.exp(-time / 50), abs=0.01)


def test_band_holds_the_estimate():
    random = np.random.default_rng(2)
    curve = incidence(random.integers(0, 200, 100), random.random(100) < 0.6)
    assert (curve.low <= curve.fraction).all() and (curve.fraction <= curve.high).all()


def test_event_that_never_comes():
    curve = incidence(np.array([5.0, 6.0]), np.array([False, False]))
    assert curve.events == 0 and curve.n == 2 and not curve.fraction.any() and np.isnan(curve.quantile(0.5))


@pytest.mark.parametrize("delay", [[-1.0, 2.0], [np.nan, 2.0], [1.0]])
def test_bad_delays_are_refused(delay):
    with pytest.raises(ValueError, match="incidence"):
        incidence(np.array(delay), np.array([True, True]))
