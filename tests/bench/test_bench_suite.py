"""All parts in one run: what one of them breaks is a line, what does not fit is named, each can
be asked for.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import pickle
import time
from typing import get_args

import bench_work
import made_up_findings as made_up
import pytest

from ravenjax.bench import apart, effort, parts, suite
from ravenjax.bench.effort import PartCost
from ravenjax.bench.parts import BenchPart
from ravenjax.cli import machine as commands
from ravenjax.cli import main

NONE = PartCost(0.1, 0.0, 1.0)


@pytest.fixture
def some(monkeypatch):
    """Measures the parts that it is given."""
    monkeypatch.setattr(suite.machine, "describe", bench_work.machine)

    def of(total_s, *listed, **more):
        monkeypatch.setattr(parts, "PARTS", listed)
        return suite.measure(total_s, **more)

    return of


def test_a_part_that_breaks_spoils_no_other(some):
    found = some(
        60.0,
        BenchPart("cores", "cores", "", bench_work.crashes, NONE),
        BenchPart("campaigns", "campaigns", "", bench_work.answers, NONE),
        BenchPart("peak simd", "peak", "", bench_work.answers, NONE, True, ("simd",)),
    )
    assert found.machine == bench_work.MACHINE and found.campaigns == 42.0
    assert found.peak == {"simd": 42.0} and found.cores is None
    assert found.absent == {"cores": "its process ended with code 9 and no answer"}
    assert [one.name for one in found.clocks] == ["cores", "campaigns", "peak simd"]
    assert all(one.seconds > 0.0 and one.measuring_s <= 1.0 for one in found.clocks)
    assert (
        not found.is_empty
        and suite.BenchFindings(None, 0.0, 0.0, found.clocks[:1], found.absent).is_empty
    )
    assert math.isnan(found.clocks[0].peak_mb) and found.clocks[1].peak_mb > 5.0


def test_a_part_that_hangs_is_ended_in_time(some, monkeypatch):
    monkeypatch.setattr(suite, "LATE_S", 0.5)
    began = time.perf_counter()
    found = some(
        3.0,
        BenchPart("cores", "cores", "", bench_work.sleeps, NONE),
        BenchPart("campaigns", "campaigns", "", bench_work.answers, NONE),
    )
    assert time.perf_counter() - began < 30.0 and "not finished within" in found.absent["cores"]
    assert "left out" in found.absent["campaigns"] and found.campaigns is None


def test_what_does_not_fit_is_named_with_its_time(some):
    found = some(
        10.0, BenchPart("cores", "cores", "", bench_work.crashes, PartCost(1000.0, 1.0, 1.0))
    )
    assert (
        found.clocks == ()
        and found.is_empty
        and "--seconds" in found.absent["cores"]
        and "it takes" in found.absent["cores"]
    )


def test_parts_that_need_a_gpu_are_not_tried_without(some):
    gpu = BenchPart("devices", "devices", "", bench_work.crashes, NONE, needs_gpu=True)
    assert some(60.0, gpu).absent == {"devices": "no GPU"}


def test_a_machine_that_cannot_be_described_is_told(some, monkeypatch):
    monkeypatch.setattr(suite.machine, "describe", bench_work.no_machine)
    found = some(
        60.0, BenchPart("devices", "devices", "", bench_work.crashes, NONE, needs_gpu=True)
    )
    assert found.machine is None
    assert found.absent == {
        "machine": "RuntimeError: no CPU",
        "devices": "the machine is not known",
    }


def test_devices_are_counted_by_processes_of_their_own(some, monkeypatch):
    gpus = dataclasses.replace(bench_work.MACHINE, gpus=("a GPU",) * 3, no_gpu="")
    monkeypatch.setattr(suite.apart, "run", lambda work, *a, **k: apart.Answer(gpus, "", 0.1, 1.0))
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "5,6,7")
    asked = []

    def measure(share, names, environment, limit_s):
        asked.append((share, names, environment["RAVENJAX_CACHE"], limit_s))
        return made_up.whole().cores

    monkeypatch.setattr(suite.devices, "measure", measure)
    (part,) = (part for part in parts.PARTS if part.name == parts.DEVICES)
    found = some(200.0, part)
    ((share, names, folder, limit_s),) = asked
    assert (
        names == ["5", "6", "7"]
        and share > 3.0
        and folder not in ("", "off")
        and share < limit_s < 220.0
    )
    assert found.devices == made_up.whole().cores


def test_only_parts_that_time_no_start_share_a_cache(some):
    names = ("cores", "fault_times", "campaigns")
    found = some(60.0, *(BenchPart(name, name, "", bench_work.cache, NONE) for name in names))
    assert found.cores == found.fault_times != found.campaigns == "off"
    assert not os.path.exists(found.cores)


def test_quick_runs_say_what_they_leave_out(some):
    listed = (
        BenchPart("campaigns", "campaigns", "", bench_work.answers, NONE),
        BenchPart("peak simd", "peak", "", bench_work.answers, NONE, True, ("simd",)),
    )
    found = some(60.0, *listed, quick=True)
    assert found.absent == {"campaigns": "left out of a quick run"} and found.peak
    asked = some(60.0, *listed, quick=True, only=["campaigns"])
    assert asked.absent == {} and asked.campaigns is not None and not asked.peak


def test_every_part_can_be_asked_for_and_travels():
    assert get_args(commands.PartName) == parts.NAMES
    assert {part.option for part in parts.PARTS} == set(parts.NAMES)
    assert len({part.name for part in parts.PARTS}) == len(parts.PARTS)
    for part in parts.PARTS:
        assert pickle.loads(pickle.dumps(part.work)) is part.work
    one, two, eight = (
        next(part.cost for part in parts.wanted(False, ("devices",), gpus)) for gpus in (1, 2, 8)
    )
    assert 0.0 < one.usual_s < two.usual_s < eight.usual_s


def test_times_that_make_no_sense_are_refused(capsys):
    for seconds in ("1", "-5", "nan", "1e9"):
        assert main(["bench", "--seconds", seconds]) == 2
        assert f"--seconds {float(seconds):g}: expected {effort.LEAST_S:g} to" in "".join(
            capsys.readouterr()
        )
    assert main(["bench", "--only", "everything"]) == 2


@pytest.mark.slow
def test_the_whole_in_little_time(capsys, tmp_path):
    """Whatever fits is measured, whatever does not is named, and every value is there or has its
    reason.
    """
    page = tmp_path / "page.md"
    began = time.perf_counter()
    assert main(["bench", "--seconds", "60", "--json", "--markdown", str(page)]) == 0
    assert time.perf_counter() - began < 60.0 + suite.LATE_S + 45.0
    found = json.loads(capsys.readouterr().out)
    timed = {one["name"] for one in found["clocks"]}
    assert timed | set(found["absent"]) == {part.name for part in parts.PARTS}
    assert {"engine simd", "peak simd", "operations"} <= timed - set(found["absent"])
    assert found["engines"][0]["batches"][0]["ticks_per_s"] > 1e4 and found["sentences"]
    assert "## Time that each part took" in page.read_text()


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["cores", "fault_times", "campaigns", "shell", "software", "peers"]
)
def test_a_part_asked_for_alone(name, capsys):
    assert main(["bench", "--only", name, "--seconds", "400", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    due = [part for part in parts.PARTS if part.option == name]
    lacking = {part.name for part in due if part.needs_gpu and not found["machine"]["gpus"]}
    assert set(found["absent"]) == lacking
    assert {one["name"] for one in found["clocks"]} == {part.name for part in due} - lacking
    assert found["sentences"]
