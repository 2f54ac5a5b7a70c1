"""The expected cost: near what was measured, and growing with what costs."""

import pytest

from ravenjax.campaign.inspection.estimate import CostFactors, estimate_cost, measure_speed

MEASURED = {
    "quick": (3.3, 7.2, CostFactors(2571, 3000, 12, sites=30, cues=4)),
    "haptic_sweep": (5.2, 9.9, CostFactors(3124, 4000, 32, sites=30, slots=4, cues=126)),
    "safecomp45": (6.5, 11.5, CostFactors(463, 7000, 463, arms=2, sites=18, slots=6)),
    "seed_burst": (3.5, 6.6, CostFactors(81, 40000, 81)),
    "drawn_robots": (2.4, 6.5, CostFactors(64, 10000, 64)),
    "dsn16_a": (5.7, 7.6, CostFactors(1921, 5000, 1921)),
}
"""Seconds of a core with a filled and an empty cache, on the machine that the model names."""


@pytest.mark.parametrize("name", MEASURED)
def test_the_model_is_near_what_was_measured(name):
    filled, empty, work = MEASURED[name]
    cost = estimate_cost(work, "simd", 1.0)
    assert empty / 2 < cost.start_s + cost.run_s < 2 * filled


def test_machines():
    work = CostFactors(100_000, 3000, 1)
    simd = estimate_cost(work, "simd", 2.0).run_s
    assert estimate_cost(work, "simd", 4.0).run_s == pytest.approx(simd / 2, rel=0.05)
    assert estimate_cost(work, "cuda", 16.0).run_s < simd / 10
    assert estimate_cost(work, "xla", 2.0).run_s > 100 * simd
    assert measure_speed() > 0.01
