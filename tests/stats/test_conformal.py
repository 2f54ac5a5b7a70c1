"""Thresholds with a guarantee: against tables, brute force, and many calibrations with a known
truth.
"""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import binom, kstest

from ravenjax.stats.conformal import shift, threshold
from ravenjax.stats.conformal.threshold import FalseAlarmTarget, OperationScores, TooFewUnits


def target(risk: float, confidence: float = 0.95, length_h: float = 0.1) -> FalseAlarmTarget:
    """Whose risk of an operation is `risk`."""
    return FalseAlarmTarget(risk / (1 - risk) / length_h, confidence, length_h)


def one_a_unit(score: np.ndarray, length_h: float = 0.1) -> OperationScores:
    return OperationScores(np.arange(len(score)), score, np.full(len(score), length_h))


@pytest.mark.parametrize(
    ("risk", "confidence", "units"), [(0.05, 0.95, 59), (0.01, 0.95, 299), (0.1, 0.99, 44)]
)
def test_as_few_units_as_wilks_has_them(risk, confidence, units):
    assert target(risk, confidence).min_units == units
    with pytest.raises(TooFewUnits, match=f"got {units - 1} units, expected at least {units}"):
        threshold.smallest_threshold(one_a_unit(np.arange(units - 1.0)), target(risk, confidence))
    assert (
        threshold.smallest_threshold(
            one_a_unit(np.arange(float(units))), target(risk, confidence)
        ).value
        == units - 1
    )


@pytest.mark.parametrize(("units", "alarms"), [(59, 0), (92, 0), (93, 1), (124, 2), (153, 3)])
def test_as_many_alarms_as_wilks_allows(units, alarms):
    """Second to fourth largest of 93, 124, 153: tables of one-sided 95/95 tolerance limits."""
    result = threshold.smallest_threshold(
        one_a_unit(np.random.default_rng(1).permutation(float(units) + np.arange(units))),
        target(0.05),
    )
    assert result.alarms == alarms and result.value == 2 * units - 1 - alarms


@pytest.mark.parametrize("shape", ["shares", "whole", "mixed", "constant"])
def test_betting_keeps_its_level_at_the_risk_itself(shape):
    """Losses whose mean is the risk: a p-value of at most 0.05 in at most 5 of 100."""
    rng, risk, times, units = np.random.default_rng(6), 0.05, 2000, 150
    rare = rng.random((times, units)) < 0.1
    losses = {
        "shares": rng.binomial(16, risk, (times, units)) / 16,
        "whole": rng.random((times, units)) < risk,
        "mixed": np.where(rare, rng.beta(0.5, 0.5, (times, units)), 0.0),
        "constant": np.full((times, units), risk),
    }[shape]
    p = np.array([threshold.excess_p(one.astype(float), risk, 0.95) for one in losses])
    assert (p <= 0.05).sum() <= binom.ppf(0.999, times, 0.05)


@given(
    st.lists(st.floats(allow_nan=True, width=32), min_size=60, max_size=90),
    st.integers(1, 3),
    st.floats(0.05, 0.3),
)
@settings(max_examples=60, deadline=None)
def test_the_threshold_is_the_least_that_is_not_rejected(scores, a_unit, risk):
    score, wanted = np.array(scores), target(risk)
    some = OperationScores(np.arange(len(score)) // a_unit, score, np.full(len(score), 0.1))
    plain = np.where(np.isnan(score), np.inf, score)

    def fine(value: float) -> bool:
        alarms = plain > value
        losses = [alarms[some.unit == unit].mean() for unit in np.unique(some.unit)]
        return threshold.excess_p(np.array(losses), wanted.risk, 0.95, a_unit == 1) <= 0.05

    descending = sorted({value for value in plain if np.isfinite(value)}, reverse=True)
    candidates = list(itertools.takewhile(fine, descending))
    if not candidates:
        with pytest.raises(TooFewUnits):
            threshold.smallest_threshold(some, wanted)
        return
    result = threshold.smallest_threshold(some, wanted)
    assert result.value == candidates[-1] and result.alarms == (plain > result.value).sum()


def clustered(rng: np.random.Generator, units: int, each: int, spread: float) -> OperationScores:
    """Scores whose unit shares a part of them: normal, correlation spread^2."""
    common, own = rng.normal(size=(units, 1)), rng.normal(size=(units, each))
    score = (spread * common + np.sqrt(1 - spread**2) * own).ravel()
    return OperationScores(np.repeat(np.arange(units), each), score, np.full(units * each, 0.1))


@pytest.mark.parametrize(("each", "spread"), [(1, 0.0), (8, 0.9)])
def test_the_risk_is_kept_with_the_confidence_and_the_naive_quantile_does_not(each, spread):
    """Truth is the normal distribution's: the risk of a threshold is that of one fresh
    operation.
    """
    from scipy.stats import norm

    rng, wanted, calibrations = np.random.default_rng(7), target(0.05, 0.9), 400
    above, naive = 0, 0
    for _ in range(calibrations):
        some = clustered(rng, 120, each, spread)
        above += norm.sf(threshold.smallest_threshold(some, wanted).value) > wanted.risk
        naive += norm.sf(np.quantile(some.score, 1.0 - wanted.risk, method="higher")) > wanted.risk
    assert above <= binom.ppf(
        0.999, calibrations, 0.1
    )  # of promises that hold, one in a thousand tests is above
    assert naive >= binom.ppf(0.999, calibrations, 0.25)  # so that this test can fail


def test_the_rate_is_kept_where_only_a_part_of_the_hours_counts():
    """Alarms at a constant rate end operations: at the risk that is allowed the rate an hour is
    the one stated.
    """
    wanted, rng = FalseAlarmTarget(2.0, 0.95, 0.1), np.random.default_rng(3)
    hours = rng.uniform(0.02, 0.1, 200_000)
    until = rng.exponential(1 / 2.0, len(hours))
    alarm = until < hours
    loss = np.where(alarm, 1.0, wanted.without_alarm(hours))
    rate = alarm.sum() / np.minimum(until, hours).sum()
    assert rate == pytest.approx(2.0, rel=0.02)
    assert (
        loss.mean() > wanted.risk
    )  # hours before an alarm are left out: the loss says more than there are
    assert loss.mean() == pytest.approx(wanted.risk, rel=0.1)


def test_p_values_are_uniform_and_independent_where_nothing_changed():
    rng = np.random.default_rng(5)
    p = np.array(
        [
            shift.p_values(rng.integers(0, 4, 30), rng.integers(0, 4, 20), seed)
            for seed in range(300)
        ]
    )
    assert kstest(p.ravel(), "uniform").pvalue > 0.001
    assert abs(np.corrcoef(p[:, 10], p[:, 11])[0, 1]) < 4 / np.sqrt(300)


def test_the_level_is_kept_and_a_changed_robot_is_reported():
    rng, level, times = np.random.default_rng(2), 0.05, 400
    same = [
        shift.test_shift(rng.normal(size=60), rng.normal(size=15), s).p <= level
        for s in range(times)
    ]
    assert sum(same) <= binom.ppf(0.999, times, level)
    higher = [shift.test_shift(rng.normal(size=60), rng.normal(2.0, size=15), s) for s in range(20)]
    assert all(one.p <= level and one.median_rank > 0.8 for one in higher)
    wider = [
        shift.test_shift(rng.normal(size=200), 6 * rng.normal(size=60), s).p <= level
        for s in range(20)
    ]
    assert all(wider)


def test_the_martingale_has_mean_one_and_grows_against_small_p_values():
    rng = np.random.default_rng(1)
    ends = [shift.martingale_capital(rng.random(40))[-1] for _ in range(4000)]
    assert np.mean(ends) == pytest.approx(1.0, abs=5 * np.std(ends) / np.sqrt(4000))
    assert shift.martingale_capital(np.full(40, 0.02))[-1] > 100


def test_the_joint_score_is_the_largest_over_time_to_the_bit():
    rng = np.random.default_rng(4)
    series = rng.exponential(size=(20, 500, 3)).astype(
        np.float32
    )  # operations, milliseconds, signals
    segment = rng.integers(0, 2, 500)
    peaks = np.stack([series[:, segment == one].max(axis=1) for one in (0, 1)], axis=-1)
    scale = threshold.signal_scales(peaks)
    live = (series / scale[:, segment].T[None]).max(axis=(1, 2))
    assert live.dtype == np.float32 and (threshold.joint_scores(peaks, scale) == live).all()


def test_a_signal_that_is_always_zero_has_a_scale():
    peaks = np.zeros((5, 2, 2))
    peaks[:, 0, 0] = 3.0
    assert threshold.signal_scales(peaks).tolist() == [[3.0, np.float32(3e-6)], [1.0, 1.0]]
    with pytest.raises(ValueError, match="finite"):
        threshold.signal_scales(np.full((2, 1, 1), np.inf))
