"""Dependence of a rate on an input over units: found where it is, seldom where it is not; units
count, not rows.
"""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.stats.bootstrap import units
from ravenjax.stats.inputs.dependence import dependences

KINDS, EACH = 24, 20
KIND = np.repeat(np.arange(KINDS), EACH)
RANDOM = np.random.default_rng(5)


def test_finds_a_rate_that_rises_and_one_that_is_worst_at_both_ends():
    random = np.random.default_rng(1)
    inputs = {name: random.uniform(-1, 1, len(KIND)) for name in ("rising", "hollow", "idle")}
    chance = (
        random.uniform(0.2, 0.5, KINDS)[KIND]
        + 0.25 * inputs["rising"]
        + 0.3 * (inputs["hollow"] ** 2 - 0.3)
    )
    hit = random.random(len(KIND)) < chance
    found = {one.name: one for one in dependences(hit, inputs, units.units(KIND))}
    assert {name for name, one in found.items() if one.depends} == {"rising", "hollow"}
    rising = found["rising"]
    assert (
        rising.difference.low < 0.25 * 4 / 3 < rising.difference.high and rising.difference.low > 0
    )


def test_units_that_share_a_value_count_once():
    """Twelve robots under the same faults: one of them is bad, which rows take for a clear
    dependence.
    """
    robot = np.repeat(np.arange(12), 50)
    value = np.arange(12.0)[robot]
    hit = RANDOM.random(len(robot)) < np.where(robot == 8, 0.9, 0.1)
    (rows,) = dependences(hit, {"x": value}, units.units(np.arange(len(hit))))
    (robots,) = dependences(hit, {"x": value}, units.units(robot))
    assert rows.depends and not robots.depends


@pytest.mark.slow
@pytest.mark.parametrize(
    "shared", [False, True], ids=["each fault its own robot", "robots that faults share"]
)
def test_false_finds_are_as_rare_as_promised(shared):
    wrong = 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        chance = random.beta(0.5, 0.5, KINDS)[KIND]  # kinds that nearly always or nearly never hit
        hit = random.random(len(KIND)) < chance
        x = random.normal(size=KINDS)[KIND] if shared else random.normal(size=len(KIND))
        (one,) = dependences(hit, {"x": x}, units.units(KIND))
        wrong += one.depends
    assert wrong <= 7  # 2 expected; more in one of 1000 such tests


def test_an_input_that_differs_between_kinds_alone_tells_no_kinds_apart_from_it():
    """Each kind has a value of its own: kinds are exchanged, so that a chance order of kinds is
    no finding.
    """
    x = np.linspace(0, 1, KINDS)[KIND]
    hit = np.isin(KIND, [0, 3, 7, 11, 14, 19])
    (one,) = dependences(hit, {"x": x}, units.units(KIND))
    assert one.p > 0.1


def test_tied_values_stay_together_and_what_has_no_value_is_left_out():
    x = np.repeat([0.0, 1.0, 2.0, np.nan], [900, 60, 40, 10])
    (one,) = dependences(np.arange(1010) % 7 == 0, {"x": x}, units.units(np.arange(1010)))
    assert [(level.least, level.greatest, level.rate.n) for level in one.levels] == [
        (0, 0, 900),
        (1, 2, 100),
    ]


def test_what_never_varies_is_no_hypothesis():
    hit, among = np.arange(100) % 2 == 0, units.units(np.arange(100))
    inputs = {"same": np.ones(100), "x": np.arange(100.0) + 50 * hit}
    found = {one.name: one for one in dependences(hit, inputs, among)}
    assert np.isnan(found["same"].p) and not found["same"].depends
    assert found["x"].adjusted == found["x"].p and found["x"].depends
    assert np.isnan(dependences(np.zeros(100, bool), {"x": np.arange(100.0)}, among)[0].p)
