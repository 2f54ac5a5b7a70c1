"""Margins and stated rates against closed forms, and what they promise against simulation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from ravenjax.analyses.monitors.counterfactual import check_set, output
from ravenjax.analyses.monitors.counterfactual.candidates import MARGINS, Question
from ravenjax.analyses.monitors.counterfactual.check_set import Evidence
from ravenjax.analyses.monitors.counterfactual.observation import NEVER, EvadingFaults, FreeMotion
from ravenjax.stats.alarms.false_alarms import hours_to_bound


def motion(peaks, hours=0.1):
    peaks = np.asarray(peaks, np.float32)
    return FreeMotion(peaks, np.full(peaks.shape, hours))


def test_the_least_margin_that_keeps_the_rate_is_taken():
    peaks = np.full((99, 1), 0.5)
    peaks[:3, 0] = 1.05, 1.3, 4.0
    assert (
        check_set.calibrate_margin(motion(peaks), 0.41).value == 1.0
    )  # (3 alarms + 1) / 100 motions / 0.1 h
    assert check_set.calibrate_margin(motion(peaks), 0.39).value == 1.1
    assert check_set.calibrate_margin(motion(peaks), 0.21).value == 1.5
    assert check_set.calibrate_margin(motion(peaks), 0.11).value == 5.0
    assert check_set.calibrate_margin(motion(peaks), 100.0).value == 1.0


def test_one_motion_more_keeps_the_rate_at_the_mean_whatever_the_scores():
    rng = np.random.default_rng(7)
    alarms, hours, asked = 0, 0.0, 4.0
    for _ in range(2000):
        operator = rng.lognormal(-0.4, 0.5, (20, 1))  # the runs of a motion resemble each other
        peaks = operator * rng.uniform(0.8, 1.25, (20, 2))
        margin = check_set.calibrate_margin(motion(peaks[:-1]), asked)
        assert margin.expected_per_hour <= asked
        alarms += int((np.float32(peaks[-1]) > np.float32(margin.value)).sum())
        hours += 0.2
    assert (
        stats.poisson.cdf(alarms / 2, asked * hours / 2) < 0.999
    )  # two runs of a motion alarm together


def test_stated_alarms_have_the_exact_poisson_interval():
    peaks = np.full((50, 1), 0.9)
    peaks[:4] = 2.0
    rate = check_set.false_alarm_rate(motion(peaks), 1.5)
    assert (rate.count, rate.hours, rate.per_hour) == (4, pytest.approx(5.0), pytest.approx(0.8))
    assert rate.low == pytest.approx(stats.chi2.ppf(0.025, 8) / 2 / 5)
    assert rate.high == pytest.approx(stats.chi2.ppf(0.975, 10) / 2 / 5)


def test_runs_of_one_motion_are_no_further_motions():
    peaks = np.full((10, 4), 0.9)
    peaks[0] = 2.0  # one operator's motion, all its robots
    together, alone = (
        check_set.false_alarm_rate(motion(peaks), 1.5),
        check_set.false_alarm_rate(motion(peaks[:, :1]), 1.5),
    )
    assert together.count == 4 and together.per_hour == pytest.approx(alone.per_hour)
    assert (together.low, together.high) == pytest.approx((alone.low, alone.high))


def test_hours_that_show_a_rate_show_it():
    hours = hours_to_bound(0.5)
    assert check_set.false_alarm_rate(
        motion(np.zeros((10, 1)), hours / 10), 1.0
    ).high == pytest.approx(0.5)
    for rate in (0.1, 0.5, 4.0, 30.0):
        assert output.hours_needed(rate) >= 2 * hours_to_bound(rate)
    enough = output.hours_needed(2.0, runs=4) / 2  # of the half that states
    assert check_set.false_alarm_rate(motion(np.zeros((10, 4)), enough / 40), 1.0).high <= 2.0


def evidence(lead, lead_ms=10, groups=None, robots=None):
    """Of runs [runs, candidates] with these leads at every margin."""
    lead = np.asarray(lead)
    runs, among = lead.shape
    group = np.array(["a"] * runs if groups is None else groups)
    unit = np.arange(runs) if robots is None else np.asarray(robots)
    faults = EvadingFaults(
        group,
        np.ones(runs, bool),
        unit,
        robots is not None,
        np.repeat(lead[:, :, None], len(MARGINS), axis=2),
    )
    free = FreeMotion(np.full((8, 1, among), 0.5, np.float32), np.full((8, 1), 1.0))
    return Evidence(Question(lead_ms=lead_ms), free, free, faults, *faults.halves(0))


@given(st.lists(st.integers(1, 30), min_size=1, max_size=6), st.integers(0, 5))
def test_halves_are_halves_of_every_group(sizes, seed):
    groups = np.repeat([f"g{k}" for k in range(len(sizes))], sizes)
    faults = evidence(np.zeros((len(groups), 1)), groups=groups).faults
    mine, others = faults.halves(seed)
    assert abs(int(mine.sum()) - int(others.sum())) <= 1
    for name in np.unique(groups):
        assert abs(int(mine[groups == name].sum()) - int(others[groups == name].sum())) <= 1


def test_a_robot_lies_in_one_half_and_widens_the_interval():
    robots = np.repeat(np.arange(12), 10)
    lead = np.where(robots % 3 == 0, NEVER, 100)[:, None]  # all faults of a robot alike
    one = evidence(lead, robots=robots)
    assert not set(robots[one.selection_half]) & set(robots[one.test_half])
    alone = evidence(lead)
    wide, narrow = one.assess([0]).test_coverage, alone.assess([0]).test_coverage
    assert wide.high - wide.low > 1.5 * (narrow.high - narrow.low)
