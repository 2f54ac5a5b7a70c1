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

    def __init__(self, *there):
        self.there = there

    def holds(self, key):
        return key[2] in self.there


@pytest.mark.parametrize(
    ("there", "vain", "sizes", "grouped"),
    [
        ((), 0, (16, 8), True),
        ((), 0, (4, *(1,) * 12), False),
        ((True,), 0, (4, *(1,) * 12), True),  # the form that is there serves
        ((True,), simd.REPAID, (4, *(1,) * 12), False),  # until that has cost as much
        ((False,), 0, (16, 8), False),
        ((False, True), 0, (16, 8), True),
    ],
)
def test_lanes_run_by_group_where_that_is_cheaper(ready, there, vain, sizes, grouped):
    one = SimdKernel(dataclasses.replace(ready.program, ticks=1000), 16)
    one.width, one._vain, one._forms = WIDTH, vain, Forms(*there)
    assert one._runs_by_group(np.array(sizes)) == grouped


@pytest.mark.slow
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
    first, second = found
    assert (
        first.outcomes.keys() == second.outcomes.keys()
        and (first.outcomes["active_ticks"] > 0).any()
    )
    for name, values in first.outcomes.items():
        np.testing.assert_array_equal(values, second.outcomes[name], err_msg=name)
