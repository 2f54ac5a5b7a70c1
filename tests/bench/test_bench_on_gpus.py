"""What the benchmark asks of GPUs, asked of real ones; skipped, with one line, where there are
none.

The same functions are asked of a CPU in `test_scaling.py` and `test_fault_times.py`.
"""

from __future__ import annotations

import pytest

from ravenjax.bench import apart, devices, fault_times, machine, peak, placement, speed, start
from ravenjax.bench.devices import DeviceWork

SMALL = DeviceWork("cuda", 8192, 200, 4096)


@pytest.fixture(scope="module")
def gpus():
    here = apart.run(machine.describe, limit_s=120.0).value
    if not here.gpus:
        pytest.skip(here.no_gpu)
    return placement.visible_gpus(len(here.gpus))


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RAVENJAX_CACHE", str(tmp_path / "cache"))
    return {"RAVENJAX_CACHE": str(tmp_path / "cache")}


def test_every_number_of_gpus_is_measured(gpus, own_cache):
    found = devices.measure(1.0, gpus, own_cache, 300.0, SMALL)
    assert found.note == "" and [point.count for point in found.points] == devices.counts(len(gpus))
    for point in found.points:
        assert point.runs == point.count * found.points[0].runs
        assert min(*point.kernel.values, *point.campaign.values) > 1e5


def test_runs_cost_what_comes_after_their_fault(gpus, own_cache):
    found = fault_times.measure(1.0, "cuda", 400, 50, (0.0, 0.9), 4096)
    assert found.engine == "cuda" and min(one.run_s.smallest for one in found.times) > 0.0


def test_engine_and_peak_are_measured(gpus):
    assert peak.measure(0.5, "cuda") > 1e12
    answer = apart.run(
        speed.of_engine, 1.0, "cuda", limit_s=300.0, environment={"RAVENJAX_CACHE": "off"}
    )
    assert answer.why == "" and answer.value.best.ticks_per_s > 1e6 and answer.value.ready_s > 0.0


def test_a_campaign_is_run_from_the_shell(gpus):
    cold, others = start.measure_large(0.0, 4096, 0.5)
    assert cold.seconds.smallest > 0.0 and others.peak_mb > 10.0
