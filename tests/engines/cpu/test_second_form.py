"""A second form of the vector code is made where it is repaid, and changes no bit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import ravenjax as rj
from ravenjax.campaign import plan
from ravenjax.engines import traced
from ravenjax.engines.cpu import engine as simd
from ravenjax.engines.cpu.engine import SimdEngine, SimdKernel
from ravenjax.engines.interface import Block

WIDTH = 8
FAULT = {
    "site": "usb_out",
    "channel": "elbow",
    "effect": "offset",
    "value": [*range(500, 10_500, 500)],
    "start_ms": 20,
}


@pytest.fixture(scope="module")
def ready():
    return plan.make_plan(
        rj.load_campaign(
            {
                "campaign": {"name": "forms", "duration_s": 0.1},
                "operator": {"motion": "reach"},
                "group": [
                    {"name": "shared", "fault": [FAULT]},
                    {
                        "name": "drawn",
                        "design": "random",
                        "runs": 5,
                        "fault": [FAULT],
                        "parameters": {"plant.mass_scale": {"uniform": [0.9, 1.1]}},
                    },
                ],
            }
        )
    )


class Forms:
    """What a kernel sees of its forms of code."""

    def __init__(self, *there, kept=False):
        self.there, self.kept = there, kept

    def holds(self, key):
        return key[2] in self.there

    def keeps(self, kind, key):
        return self.kept


def kernel(ready, *there, kept=False, vain=0.0):
    one = SimdKernel(dataclasses.replace(ready.program, ticks=1000), 16)
    one.width, one._vain, one._forms = WIDTH, vain, Forms(*there, kept=kept)
    return one


def planned(one, *sizes):
    """The parts of groups of so many lanes, (lanes, grouped), and the vectors that are run in
    vain.
    """
    group = np.repeat(np.arange(len(sizes)), sizes)
    parts, vain = one._at_hand(simd._parts(group, WIDTH), group)
    assert sorted(np.concatenate([part.lanes for part in parts]).tolist()) == list(
        range(len(group))
    )
    return sorted((len(part.lanes), part.grouped) for part in parts), vain


MIXED = (16, 1, 1, 1)
BOTH = [(3, False), (16, True)]
GROUPED = [(1, True), (1, True), (1, True), (16, True)]


@pytest.mark.parametrize("there", [(), (True,)])
def test_few_lanes_take_the_form_of_the_others(ready, there):
    assert planned(kernel(ready, *there), *MIXED) == (GROUPED, 2.0)


def test_a_form_that_is_there_is_used(ready):
    assert planned(kernel(ready, False, True), *MIXED) == (BOTH, 0.0)


def test_a_form_that_is_kept_is_used(ready):
    assert planned(kernel(ready, kept=True), *MIXED) == (BOTH, 0.0)


def test_a_second_form_is_made_when_its_lack_has_cost_as_much(ready):
    almost = simd.REPAID - 2 * 1000
    assert planned(kernel(ready, vain=almost), *MIXED)[0] == GROUPED
    assert planned(kernel(ready, vain=almost + 1), *MIXED) == (BOTH, 0.0)


def test_many_lanes_at_once_are_worth_a_form(ready):
    alone = simd.REPAID // 1000 + 100
    assert planned(kernel(ready), alone + 8, *(1,) * alone) == (
        [(alone, False), (alone + 8, True)],
        0.0,
    )


def test_where_most_lanes_stand_alone_so_do_all(ready):
    parts, vain = planned(kernel(ready), 4, *(1,) * 12)
    assert parts == [(16, False)] and vain == -1 + 3 * simd.UNSHARED


def test_one_way_is_one_form(ready):
    assert planned(kernel(ready), 16, 8) == ([(8, True), (16, True)], 0.0)


def test_either_way_gives_the_same_bits(ready, monkeypatch):
    loop = traced.trace(
        traced.printable(ready.program), Block(*ready.lanes([0], 1), None), ready.columns
    )
    forms, found = traced.Forms(loop), []
    for repaid in (10**9, -1):
        monkeypatch.setattr(simd, "REPAID", repaid)
        one = SimdEngine().compile(ready.program, ready.runs)
        one._forms = forms
        rows = np.arange(one.size(ready.runs)) % ready.runs
        golden = one.run(Block(*ready.lanes(rows, len(rows), harmless=True), None), ready.columns)
        found.append(one.run(Block(*ready.lanes(rows, len(rows)), golden.reference), ready.columns))
        assert {way for way in (False, True) if forms.holds(one._key(way))} == (
            {True} if repaid > 0 else {False, True}
        )
        assert (one._vain > 0) == (repaid > 0)
    first, second = found
    assert (
        first.outcomes.keys() == second.outcomes.keys()
        and (first.outcomes["active_ticks"] > 0).any()
    )
    for name, values in first.outcomes.items():
        np.testing.assert_array_equal(values, second.outcomes[name], err_msg=name)
