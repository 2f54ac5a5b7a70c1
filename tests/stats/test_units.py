"""Intervals over independent units: coverage on simulated clustered data beside the naive ones,
and closed forms.
"""

import math

import numpy as np
import pytest
from scipy import stats

from ravenjax.stats import latency, units
from ravenjax.stats.intervals import wilson_interval
from ravenjax.stats.paired import exchange_p, mcnemar_test


def clustered(random, sizes, rate, icc):
    """Bool rows of units of these sizes with a beta-binomial law of this intraclass correlation,
    and their units.
    """
    weight = (1 - icc) / icc
    each = random.beta(rate * weight, (1 - rate) * weight, len(sizes))
    label = np.repeat(np.arange(len(sizes)), sizes)
    return random.random(len(label)) < each[label], label


@pytest.mark.parametrize(("count", "size"), [(90, 12), (15, 40)])
def test_a_rate_covers_what_the_naive_one_does_not(count, size):
    random = np.random.default_rng(count)
    inside = naive = 0
    trials = 300
    for trial in range(trials):
        hit, label = clustered(random, np.full(count, size), 0.3, 0.3)
        band = units.rate_band(hit, units.group_units(label), resamples=400, seed=trial)
        plain = wilson_interval(int(hit.sum()), len(hit))
        inside += band.low <= 0.3 <= band.high
        naive += plain.low <= 0.3 <= plain.high
    # rows taken as independent: a standard error too small by the root of the design effect 1 +
    # (size - 1) icc
    narrow = 2 * stats.norm.cdf(1.96 / math.sqrt(1 + (size - 1) * 0.3)) - 1
    assert inside / trials > (
        0.915 if count > units.ENOUGH_UNITS else 0.88
    )  # few units: a little too narrow, as tables say
    assert naive / trials == pytest.approx(narrow, abs=0.09) and naive / trials < 0.72


def test_few_units_have_the_variance_with_divisor_n_less_one():
    """Rao and Wu: of the mean of n units s^2 / n, where the plain bootstrap has (n - 1) / n of
    it.
    """
    value = np.random.default_rng(1).normal(size=6)
    weight = units.group_units(np.arange(6)).weights(40_000)
    assert weight.mean(axis=0) == pytest.approx(np.ones(6), abs=0.02)
    assert np.var(weight @ value / 6) == pytest.approx(value.var(ddof=1) / 6, rel=0.03)


def test_strata_are_not_mixed():
    """Two strata that differ in level alone: a band without width, and a wide one where they are
    mixed.
    """
    hit, label = np.repeat([True, False], 40), np.repeat(np.arange(20), 4)
    apart = units.rate_band(hit, units.group_units(label, np.repeat([0, 1], 40)))
    mixed = units.rate_band(hit, units.group_units(label))
    assert (apart.low, apart.high) == pytest.approx((0.5, 0.5)) and mixed.high - mixed.low > 0.3
    weight = units.group_units(label, np.repeat([0, 1], 40)).weights(50)
    assert weight[:, :10].sum(axis=1) == pytest.approx(np.full(50, 10.0))


def test_what_was_not_seen_is_not_certain_and_too_few_units_say_nothing():
    none = units.rate_band(np.zeros(200, bool), units.group_units(np.repeat(np.arange(10), 20)))
    assert none[2:] == pytest.approx(wilson_interval(0, 10)[2:]) and none.n == 200
    few = units.rate_band(np.arange(40) % 3 == 0, units.group_units(np.repeat(np.arange(4), 10)))
    assert few.value == pytest.approx(0.35) and math.isnan(few.low)
    assert math.isnan(units.rate_band([], units.group_units([])).value)


def test_wrong_units_are_refused():
    with pytest.raises(ValueError, match="several"):
        units.group_units([0, 0, 1], [0, 1, 1])
    with pytest.raises(ValueError, match="no label"):
        units.group_units(["a", None])


def test_a_ratio_is_one_of_sums():
    unit = units.group_units(np.repeat(np.arange(8), 2))
    above, below = np.arange(16.0), np.full(16, 2.0)
    band = units.ratio_band(above, below, unit, seed=3)
    assert band.value == pytest.approx(120 / 32) and band.low < band.value < band.high


def test_quantiles_of_delays_are_those_of_kaplan_and_meier():
    random = np.random.default_rng(0)
    delay = random.exponential(10, 300)
    came = delay < 15
    own = units.group_units(np.arange(300))
    for fraction in (0.25, 0.5):
        delays = latency.Delays(np.minimum(delay, 15), came, np.ones(300, int))
        curve = latency.incidence_curve(delays).quantile_interval(fraction)
        band = latency.delay_quantile(np.minimum(delay, 15), came, fraction, own)
        assert band.value == curve.value and band[1:] == pytest.approx(curve[1:], rel=0.06)
    never = latency.delay_quantile(np.minimum(delay, 15), came, 0.9, own)
    assert np.isnan(never).all()
    alike = latency.delay_quantile(
        np.repeat(delay[:30], 10),
        np.full(300, True),
        0.5,
        units.group_units(np.repeat(range(30), 10)),
    )
    alone = latency.delay_quantile(delay[:30], np.full(30, True), 0.5, units.group_units(range(30)))
    assert alike == pytest.approx(alone)  # ten copies of a run say nothing more


def test_one_row_a_unit_is_mcnemars_exact_test():
    random = np.random.default_rng(3)
    for share in (0.5, 0.4, 0.1):
        first, second = random.random(50) < 0.5, random.random(50) < share
        assert exchange_p(first, second, np.arange(50)) == pytest.approx(
            mcnemar_test(int((first & ~second).sum()), int((second & ~first).sum()))
        )
    assert math.isnan(exchange_p(first, first, np.arange(50)))


X = np.random.default_rng(0).exponential(1.0, 60)


def mean(index):
    return X[index].mean(axis=-1)


def test_the_plain_bootstrap_is_scipys_on_rows():
    band = units.bootstrap(60, mean, resamples=2000, seed=4)
    theirs = stats.bootstrap(
        (X,), np.mean, n_resamples=2000, method="percentile", rng=np.random.default_rng(4)
    )
    assert (band.low, band.high) == pytest.approx(tuple(theirs.confidence_interval), rel=1e-9)
    assert band.value == pytest.approx(X.mean())


def test_one_unit_is_refused():
    with pytest.raises(ValueError, match="at least 2 independent units, got 1"):
        units.bootstrap(1, mean)
