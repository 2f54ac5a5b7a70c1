"""The expected cost: near what was measured, and growing with what costs."""

from __future__ import annotations

import pytest

from ravenjax.campaign.inspection.estimate import CostFactors, Machine, duration, estimate, tick_ns

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


def test_a_campaign_costs_its_ticks_on_every_core():
    """2571 runs and 12 golden ones of 3000 ticks, 174 ns each, on two cores, and 12 us a run to
    store it.
    """
    work = MEASURED["quick"][1]
    cost = estimate(work, Machine("simd", 2))
    assert cost.run_s == pytest.approx((2583 * 3000 * tick_ns(work) + 2571 * 12_000) * 1e-9 / 2)
    assert 500 < cost.memory_mib < 600 and 3 < cost.start_s < 10


@pytest.mark.parametrize(
    ("more", "key"),
    [
        ({"runs": 9000}, 0),
        ({"arms": 2}, 0),
        ({"golden_runs": 8192}, 2),
        ({"sites": 30}, 2),
        ({"slots": 8}, 2),
    ],
)
def test_more_work_costs_more(more, key):
    plain = CostFactors(8192, 1000, 1)
    machine = Machine("simd", 4)
    dear, cheap = estimate(plain._replace(**more), machine), estimate(plain, machine)
    assert dear.run_s >= cheap.run_s and dear.memory_mib >= cheap.memory_mib
    assert (dear.run_s > cheap.run_s, None, dear.memory_mib > cheap.memory_mib)[key]


def test_machines():
    work = CostFactors(100_000, 3000, 1)
    simd = estimate(work, Machine("simd", 2)).run_s
    assert estimate(work, Machine("simd", 4)).run_s == pytest.approx(simd / 2)
    assert estimate(work, Machine("simd", 2, width=8)).run_s > 1.5 * simd
    assert estimate(work, Machine("cuda", 16)).run_s < simd / 10
    assert estimate(work, Machine("xla", 2)).run_s > 100 * simd


def test_memory_of_golden_runs_is_bounded():
    memory = [
        estimate(CostFactors(n, 3000, n), Machine("simd", 2)).memory_mib for n in (1000, 100_000)
    ]
    assert memory[0] == pytest.approx(501.5 + 1000 * (95 + 2 * 3000 * 24) / 2**20), (
        "series, and a copy of each"
    )
    assert memory[1] == pytest.approx(501.5 + 100_000 * 95 / 2**20 + 1536)
    shared = estimate(CostFactors(100_000, 3000, 1000), Machine("simd", 2)).memory_mib
    assert shared == pytest.approx(501.5 + (100_000 * 95 + 1000 * 3000 * 24) / 2**20)


@pytest.mark.parametrize(
    ("seconds", "words"),
    [
        (0.01, "1 s"),
        (12.3, "13 s"),
        (89, "89 s"),
        (200, "3.3 min"),
        (7200, "2 h"),
        (90_000, "25 h"),
    ],
)
def test_durations(seconds, words):
    assert duration(seconds) == words
