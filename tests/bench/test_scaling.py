"""Cores and devices are compared by as much work for each, of which every tick is computed."""

from __future__ import annotations

import os

import numpy as np
import pytest

from ravenjax.bench import cores, devices, scaling
from ravenjax.bench.clock import Repeats
from ravenjax.bench.devices import DeviceWork
from ravenjax.engines.cpu.engine import SimdEngine

SMALL = DeviceWork("simd", 64, 20, 32)
"""What GPUs are asked for, asked of a CPU: the same code but for the engine's name."""


@pytest.mark.parametrize(
    ("real", "threads", "usable", "counts"),
    [
        (1, 1, 1, [1]),
        (2, 2, 2, [1, 2]),
        (6, 6, 6, [1, 2, 4, 6]),
        (8, 16, 16, [1, 2, 4, 8, 16]),
        (8, 16, 3, [1, 2, 3]),
        (1, 2, 2, [1, 2]),
        (2, 4, 1, [1]),
    ],
)
def test_counts_of_cores(real, threads, usable, counts):
    assert cores.counts(real, threads, usable) == counts


def test_counts_of_devices():
    assert [devices.counts(n) for n in (1, 2, 3, 4, 6, 8)] == [
        [1],
        [1, 2],
        [1, 2, 3],
        [1, 2, 4],
        [1, 2, 4, 6],
        [1, 2, 4, 8],
    ]


def test_a_limit_of_time_is_told():
    assert cores.note(float("inf"), 4) == cores.note(4.0, 4) == ""
    assert "time of 1.5 of its 4 CPUs" in cores.note(1.5, 4)


def test_runs_are_as_many_as_take_the_time():
    """A campaign of a tenth of a second and a microsecond a tick."""
    asked = []

    def rate(runs):
        asked.append(runs)
        return runs * 1000 / (0.1 + runs * 1e-3)

    runs = scaling.affordable(rate, 1000, 16, 8.0)
    assert runs == 16 * 2**8 and asked == [16, 64, 256, 1024, 4096][: len(asked)]
    assert scaling.affordable(rate, 1000, 16, 0.01) == 16  # never fewer
    assert scaling.affordable(lambda runs: 1e30, 1000, 16, 8.0) <= scaling.LARGEST_RUNS


def test_rounds_are_as_many_as_fit_and_one_at_least(monkeypatch):
    def counted(seconds, each_s):
        now, done = [0.0], []

        def measure():
            done.append(1)
            now[0] += each_s

        monkeypatch.setattr(scaling.time, "perf_counter", lambda: now[0])
        monkeypatch.setattr(scaling.clock, "seconds", lambda work: (work(), each_s)[1])
        scaling.rounds(measure, seconds, 5)
        return len(done)

    assert [counted(seconds, 2.0) for seconds in (0.0, 3.9, 4.1, 7.0, 100.0)] == [1, 1, 2, 3, 5]


def test_shares_of_linear_are_those_of_the_first_point():
    one, four = (
        scaling.ScalingPoint(n, False, Repeats(k), Repeats(c), n)
        for n, k, c in ((1, (8.0, 10.0), (5.0,)), (4, (36.0,), (10.0, 8.0)))
    )
    found = scaling.Scaling("simd", (one, four), 10, 10, "")
    assert found.efficiency(one) == (1.0, 1.0) and found.efficiency(four) == (0.9, 0.5)
    assert Repeats((8.0, 10.0)).spread == pytest.approx(2.0 / 9.0) and Repeats((3.0,)).spread == 0.0


def test_the_bare_kernel_runs_every_tick_of_distinct_runs():
    bare = scaling.blocks(SimdEngine(), 20, 32, 3)
    values = np.concatenate([np.asarray(block.faults.slots[0].value) for block in bare.blocks])
    assert bare.runs == len(values) == len(np.unique(values)) == 96
    done = []
    kernel = bare.kernel

    class Watched:
        def run(self, block, motion):
            return kernel.run(block, motion, done.append)

    watched = scaling.KernelBlocks(Watched(), bare.work, bare.blocks, bare.runs)  # type: ignore[arg-type]
    assert watched.ticks_per_s(2) > 0.0 and sum(done) == 96 * 20
    done.clear()
    assert (
        watched.first(2).runs == 64
        and watched.first(2).ticks_per_s(1) > 0.0
        and sum(done) == 64 * 20
    )


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("RAVENJAX_CACHE", str(tmp_path / "cache"))
    return {"RAVENJAX_CACHE": str(tmp_path / "cache")}


def test_cores_are_measured_and_given_back(own_cache):
    before = os.sched_getaffinity(0)
    found = cores.measure(0.1, 16, 20, 20)
    assert os.sched_getaffinity(0) == before
    assert found.points[0].count == 1 and found.points[-1].count <= len(before)
    for point in found.points:
        assert point.runs % (16 * point.count) == 0
        assert min(*point.kernel.values, *point.campaign.values, 1.0) > 0.0


@pytest.mark.slow
def test_devices_are_measured_each_number_in_its_process(own_cache):
    found = devices.measure(0.5, ["0", "1"], own_cache, 120.0, SMALL)
    assert [point.count for point in found.points] == [1, 2] and found.note == ""
    assert found.points[1].runs == 2 * found.points[0].runs


def sees(seconds, number, work, runs):
    assert os.environ[devices.VISIBLE].count(",") == number - 1
    if number == 4:
        raise RuntimeError("no such device")
    return scaling.ScalingPoint(number, False, Repeats((1.0,)), Repeats((1.0,)), runs or 7)


def test_a_number_of_devices_that_fails_is_named_and_the_others_stay(monkeypatch):
    monkeypatch.setattr(devices, "point", sees)
    found = devices.measure(0.1, list("abcd"), {}, 60.0, SMALL)
    assert [(point.count, point.runs) for point in found.points] == [(1, 7), (2, 7)]
    assert found.note == "4: RuntimeError: no such device"


def fails(seconds, number, work, runs):
    raise RuntimeError("out of memory")


def test_without_a_single_device_there_is_no_scaling(monkeypatch):
    monkeypatch.setattr(devices, "point", fails)
    with pytest.raises(RuntimeError, match="1: RuntimeError: out of memory"):
        devices.measure(0.1, ["0"], {}, 60.0, SMALL)


def test_gpus_are_asked_for_as_cpus_are(own_cache):
    """All that a process does for its devices, on a CPU."""
    point = devices.point(0.1, 2, SMALL, None)
    assert point.count == 2 and point.runs == 2 * SMALL.least_runs * (
        point.runs // (2 * SMALL.least_runs)
    )
    again = devices.point(0.1, 2, SMALL, 48)
    assert again.runs == 96
