"""Adjusted p-values against a hand-computed example and simulated families."""

import numpy as np
import pytest

from ravenjax.stats.multiplicity import holm_test

P = {"b": 0.010, "a": 0.005, "d": 0.040, "c": 0.030, "e": 0.700}


def test_holm_by_hand():
    # rising: 0.005 * 5 = 0.025, 0.010 * 4 = 0.040, 0.030 * 3 = 0.090, 0.040 * 2 = 0.080 -> 0.090
    # (monotone), 0.700 * 1
    found = holm_test(P)
    assert list(found) == list(P)
    assert {name: one.adjusted for name, one in found.items()} == pytest.approx(
        {"a": 0.025, "b": 0.040, "c": 0.090, "d": 0.090, "e": 0.700}
    )
    assert {name for name, one in found.items() if one.rejected} == {"a", "b"}


def test_the_promise_holds_in_simulation(monkeypatch):
    monkeypatch.setattr("gc.collect", lambda: 0)  # statsmodels calls it each time, 50 ms
    random = np.random.default_rng(1)
    wrong = 0
    for _ in range(800):
        null = random.random(8)
        p = {f"null{i}": value for i, value in enumerate(null)} | {
            f"true{i}": 1e-5 for i in range(4)
        }
        wrong += any(one.rejected for name, one in holm_test(p).items() if name.startswith("null"))
    assert wrong / 800 < 0.05 + 3.5 * np.sqrt(0.05 * 0.95 / 800)


def test_what_was_not_tested_is_no_member():
    assert holm_test({"a": 0.03, "none": float("nan")})["a"].adjusted == 0.03
    assert not holm_test({"none": float("nan")})["none"].rejected and holm_test({}) == {}
