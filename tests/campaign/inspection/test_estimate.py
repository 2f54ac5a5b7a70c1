"""The expected cost: near what was measured, and growing with what costs."""

from __future__ import annotations

import pytest

from ravenjax.campaign.inspection.estimate import CostFactors, Machine, estimate_cost, tick_ns

MEASURED = {
    "one site": (78, CostFactors(8192, 1000, 1)),
    "both arms": (142, CostFactors(8192, 1000, 1, arms=2)),
    "64 haptic sets": (116, CostFactors(8192, 1000, 1, cues=64)),
    "32 thresholds": (102, CostFactors(8192, 1000, 1, thresholds=32)),
    "4 plant steps": (154, CostFactors(8192, 1000, 1, substeps=4)),
    "reaction": (130, CostFactors(8192, 1000, 1, reacts=True)),
    "a golden run each": (157, CostFactors(8192, 1000, 8192)),
    "quick": (169, CostFactors(2571, 3000, 12, sites=30, cues=4)),
    "hazard_library": (183, CostFactors(1810, 7000, 1, sites=30, slots=4)),
    "haptic_sweep": (413, CostFactors(3121, 4000, 33, sites=30, slots=4, cues=126)),
    "safecomp45": (229, CostFactors(463, 7000, 1, arms=2, sites=18, slots=6)),
}
"""ns of a core for a tick, measured on the machine that the model names."""


@pytest.mark.parametrize("name", MEASURED)
def test_the_model_is_near_what_was_measured(name):
    measured, work = MEASURED[name]
    assert 0.7 < tick_ns(work) / measured < 1.3


def test_machines():
    work = CostFactors(100_000, 3000, 1)
    simd = estimate_cost(work, Machine("simd", 2)).run_s
    assert estimate_cost(work, Machine("simd", 4)).run_s == pytest.approx(simd / 2)
    assert estimate_cost(work, Machine("simd", 2, width=8)).run_s > 1.5 * simd
    assert estimate_cost(work, Machine("cuda", 16)).run_s < simd / 10
    assert estimate_cost(work, Machine("xla", 2)).run_s > 100 * simd
