"""The front of two costs, against the definition."""

import numpy as np
import pytest

from ravenjax.stats.alarms.choice import unbeaten_choices


def by_definition(x, y):
    best = []
    for i in range(len(x)):
        beaten = (x <= x[i]) & (y <= y[i]) & ((x < x[i]) | (y < y[i]))
        best.append(not np.isnan(x[i] + y[i]) and not beaten.any())
    return best


@pytest.mark.parametrize("values", [6, 40, 10_000])
def test_as_defined(values):
    random = np.random.default_rng(values)
    for _ in range(50):
        x, y = random.integers(0, values, (2, 60)).astype(float)
        x[random.random(60) < 0.05] = np.nan
        assert unbeaten_choices(x, y).tolist() == by_definition(x, y)


def test_infinite_costs_and_no_choices():
    inf = np.inf
    assert unbeaten_choices([1, 2, inf], [inf, inf, 3]).tolist() == [True, False, True]
    assert (
        unbeaten_choices([inf, inf], [inf, inf]).tolist() == [True, True]
        and unbeaten_choices([], []).tolist() == []
    )
