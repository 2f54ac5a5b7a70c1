"""Incidence with censoring, against hand computation and simulation with a known law."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import CensoredData, ecdf

from ravenjax.stats import latency
from ravenjax.stats.intervals import wilson_interval
from ravenjax.stats.latency import Delays

# Weeks in remission, 6-MP against placebo: Freireich et al. 1963, the example of every textbook
# (Cox 1972; Klein and
# Moeschberger 2003, 1.2); True where the remission ended
DRUG = [6, 6, 6, 7, 10, 13, 16, 22, 23, 6, 9, 10, 11, 17, 19, 20, 25, 32, 32, 34, 35]
DRUG_ENDED = [True] * 9 + [False] * 12
PLACEBO = [1, 1, 2, 2, 3, 4, 4, 5, 5, 8, 8, 8, 8, 11, 11, 12, 12, 15, 17, 22, 23]


def incidence(delay, came):
    return latency.incidence_curve(
        Delays(np.asarray(delay), np.asarray(came), np.ones(len(delay), int))
    )


def lag_delays(alarm, harm, end):
    alarm, harm = np.asarray(alarm), np.asarray(harm)
    harmed, came = ~np.isnan(harm), ~np.isnan(alarm)
    lag = np.where(came, alarm, end)[harmed] - harm[harmed]
    return Delays(lag, came[harmed], np.ones(len(lag), int))


def test_textbook_median_interval():
    # survival::survfit(conf.type = "log-log"): placebo median 8, 4 to 11; drug 23, 13 to unknown
    assert incidence(PLACEBO, np.ones(21, bool)).quantile_interval(0.5) == (8, 4, 11)
    found = incidence(DRUG, DRUG_ENDED).quantile_interval(0.5)
    assert found[:2] == (23, 13) and np.isnan(found.high)


def test_lead_by_hand():
    nan = np.nan
    #        early  late  never  no harm  at once
    alarm = [10.0, 60.0, nan, 5.0, 30.0]
    harm = [40.0, 50.0, 20.0, nan, 30.0]
    delays = lag_delays(alarm, harm, 100)
    lags = latency.incidence_curve(delays)
    assert (lags.n, lags.events) == (4, 3) and latency.rate_before(delays) == wilson_interval(1, 4)
    assert lags.time.tolist() == [-30, -30, 0, 10, 80]
    assert [lags.quantile(share) for share in (0.25, 0.5, 0.75)] == [-30, 0, 10]
    # A quarter never had an alarm while they were watched.
    assert np.isnan(lags.quantile(0.9))


def test_lead_of_a_detector_that_misses_is_not_flattered():
    random = np.random.default_rng(7)
    harm = random.uniform(200, 400, 4000)
    alarm = harm - random.normal(20, 30, 4000)
    missed = random.random(4000) < 0.3
    delays = lag_delays(np.where(missed | (alarm > 500), np.nan, alarm), harm, 500)
    assert latency.rate_before(delays).value == pytest.approx(
        0.7 * 0.7475, abs=0.025
    )  # Phi(20 / 30) = 0.7475
    known = (
        latency.incidence_curve(delays).quantile_interval(0.35).negated
    )  # half of those that alarm
    assert known.value == pytest.approx(20, abs=4) and known.low < 20 < known.high


def test_censoring_does_not_bias():
    random = np.random.default_rng(1)
    delay, end = random.exponential(50, 20_000), random.uniform(0, 150, 20_000)
    curve = incidence(np.minimum(delay, end), delay <= end)
    for time in (20, 50, 100):
        assert np.interp(time, curve.time, curve.fraction) == pytest.approx(
            1 - np.exp(-time / 50), abs=0.01
        )


@given(st.lists(st.tuples(st.integers(0, 9), st.booleans()), min_size=1, max_size=40))
def test_counted_delays_give_the_curve_of_scipy(runs):
    times, came = np.array([time for time, _ in runs], float), np.array([hit for _, hit in runs])
    both, count = np.unique(np.stack([times, came]), axis=1, return_counts=True)
    curve = latency.incidence_curve(Delays(both[0], both[1].astype(bool), count))
    if came.any():
        truth = ecdf(CensoredData(uncensored=times[came], right=times[~came])).cdf
        np.testing.assert_allclose(curve.time[1:], truth.quantiles)
        np.testing.assert_allclose(curve.fraction[1:], truth.probabilities, atol=1e-12)
    assert (curve.low <= curve.fraction).all() and (curve.fraction <= curve.high).all()


def test_without_runs():
    assert latency.incidence_curve(latency.NO_DELAYS).n == 0
    assert np.isnan(latency.incidence_curve(latency.NO_DELAYS).quantile(0.5))
