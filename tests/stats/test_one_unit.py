"""The rate of one more unit: covered as often as promised, by simulated units whose rates are
known.
"""

import numpy as np
import pytest

from ravenjax.stats import one_unit

UNITS, TRIALS, CAMPAIGNS = 60, 30, 60


def simulated(deviation: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray, float]:
    """k and n of units whose rates have mean 0.1 and this deviation, and the rate of one more."""
    size = 0.1 * 0.9 / max(deviation, 1e-6) ** 2 - 1.0
    rates = rng.beta(0.1 * size, 0.9 * size, UNITS + 1)
    trials = rng.integers(TRIALS // 2, 2 * TRIALS, UNITS)
    return rng.binomial(trials, rates[:UNITS]), trials, float(rates[UNITS])


@pytest.mark.slow
@pytest.mark.parametrize("deviation", [0.0, 0.02, 0.06])
def test_the_next_unit_is_covered_as_often_as_promised(deviation) -> None:
    rng = np.random.default_rng(3)
    hits, deviations = [], []
    for _ in range(CAMPAIGNS):
        k, n, rate = simulated(deviation, rng)
        one = one_unit.rate_per_unit(k, n)
        hits.append(one.rate.low <= rate <= one.rate.high)
        deviations.append(one.deviation)
    assert np.mean(hits) >= 0.88 and (
        np.mean(hits) < 1.0 or deviation < 0.06
    )  # of 60: 0.95 +- 0.03
    assert np.mean(deviations) == pytest.approx(deviation, abs=0.025 if deviation == 0.0 else 0.015)


def test_differences_between_units_widen_it_as_more_trials_do_not() -> None:
    rng = np.random.default_rng(4)
    rates = rng.beta(9.0, 81.0, UNITS)
    widths = []
    for trials in (1_000, 100_000):
        n = np.full(UNITS, trials)
        one = one_unit.rate_per_unit(rng.binomial(n, rates), n)
        widths.append(one.rate.high - one.rate.low)
    low, high = np.quantile(rng.beta(9.0, 81.0, 100_000), [0.025, 0.975])
    assert widths[1] == pytest.approx(high - low, rel=0.3) and widths[0] == pytest.approx(
        widths[1], rel=0.3
    )


def test_without_second_trials_nothing_can_be_told() -> None:
    one = one_unit.rate_per_unit(np.array([0, 1, 0, 0, 1, 0, 1]), np.ones(7, int))
    assert (
        np.isnan(one.rate.low)
        and np.isnan(one.deviation)
        and one.rate.value == pytest.approx(3 / 7)
    )
    assert np.isnan(one_unit.rate_per_unit([3, 4], [10, 10]).rate.low)
