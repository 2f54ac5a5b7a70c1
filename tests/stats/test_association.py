"""Which inputs a rate depends on: found where it does, seldom where it does not."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy.stats import fisher_exact

from ravenjax.stats.inputs.association import dependences
from ravenjax.stats.intervals import wilson

N = 3000


def drawn(seed=0):
    random = np.random.default_rng(seed)
    inputs = pd.DataFrame(
        {
            "rising": random.uniform(10, 20, N),
            "hollow": random.uniform(-1, 1, N),
            "idle": random.normal(size=N),
            "flag": np.where(random.random(N) < 0.3, 1.0, 0.0),
        }
    )
    chance = 0.15 + 0.02 * (inputs["rising"] - 10) + 0.2 * inputs["hollow"] ** 2
    return random.random(N) < chance, inputs


def test_finds_what_matters_whatever_its_shape():
    hit, inputs = drawn()
    found = {one.name: one for one in dependences(hit, inputs)}
    assert {name for name, one in found.items() if one.depends} == {"rising", "hollow"}
    assert list(found)[:2] == sorted(
        list(found)[:2], key=lambda name: found[name].p
    )  # the clearest first
    assert all(one.p <= one.adjusted <= 4 * one.p for one in found.values())


@pytest.mark.slow
def test_effect_is_the_rate_in_the_outer_thirds():
    hit, inputs = drawn()
    (rising,) = dependences(hit, inputs[["rising"]])
    x = inputs["rising"].to_numpy()
    order = np.sort(x)
    for level, inside in zip(
        rising.levels,
        (x <= order[999], (x > order[999]) & (x <= order[1999]), x > order[1999]),
        strict=True,
    ):
        assert level.rate == wilson(hit[inside].sum(), inside.sum())
        assert (level.least, level.greatest) == (x[inside].min(), x[inside].max())
    low, high = rising.levels[0].rate, rising.levels[-1].rate
    assert rising.difference.value == pytest.approx(high.value - low.value)
    assert rising.difference.low < 0.02 * 20 / 3 < rising.difference.high
    (hollow,) = dependences(hit, inputs[["hollow"]])
    assert hollow.levels[1].rate.value < min(hollow.levels[0].rate.low, hollow.levels[2].rate.low)


@pytest.mark.slow
def test_false_finds_are_as_rare_as_promised(monkeypatch):
    monkeypatch.setattr("gc.collect", lambda: 0)  # statsmodels calls it each time, 50 ms
    random = np.random.default_rng(5)
    wrong = 0
    for _ in range(100):
        inputs = {f"x{i}": random.random(300) for i in range(4)} | {
            "few": random.choice([0.0, 1.0, 5.0], 300)
        }
        wrong += any(one.depends for one in dependences(random.random(300) < 0.2, inputs))
    assert wrong / 100 < 0.05 + 3.5 * np.sqrt(0.05 * 0.95 / 100)


def test_few_cases_are_tested_by_drawn_tables():
    hit = np.repeat([True, False, True, False], [3, 1, 1, 25])
    side = np.repeat([0.0, 1.0], [4, 26])
    (one,) = dependences(hit, {"side": side})
    # that of thirds is twice Fisher's at most; the lesser of the two tests counts
    assert one.p <= 2 * fisher_exact([[3, 1], [1, 25]]).pvalue + 0.01
    assert one == dependences(hit, {"side": side})[0]


def test_tied_values_stay_together():
    x = np.repeat([0.0, 1.0, 2.0], [900, 60, 40])
    (one,) = dependences(np.arange(1000) % 7 == 0, {"x": x})
    assert [(level.least, level.greatest, level.rate.n) for level in one.levels] == [
        (0, 0, 900),
        (1, 2, 100),
    ]


def test_what_never_varies_is_no_hypothesis():
    hit = np.arange(100) % 2 == 0
    found = {
        one.name: one
        for one in dependences(hit, {"same": np.ones(100), "x": np.arange(100.0) + 50 * hit})
    }
    assert (
        np.isnan(found["same"].p)
        and not found["same"].depends
        and np.isnan(found["same"].difference.value)
    )
    assert found["x"].adjusted == found["x"].p and found["x"].depends
    assert np.isnan(dependences(np.zeros(100, bool), {"x": np.arange(100.0)})[0].p)


def test_runs_without_a_value_are_left_out_of_that_input():
    hit = np.arange(100) % 2 == 0
    (one,) = dependences(hit, {"x": np.where(np.arange(100) < 40, np.nan, np.arange(100.0))})
    assert one.n == 60 == sum(level.rate.n for level in one.levels)
    (none,) = dependences(hit, {"x": np.full(100, np.nan)})
    assert none.n == 0 and none.levels == () and np.isnan(none.p)
