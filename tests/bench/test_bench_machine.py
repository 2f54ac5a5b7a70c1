"""The machine is described by what the system tells, also where it tells little."""

from __future__ import annotations

import math

import pytest

from ravenjax.bench import clock, machine


@pytest.fixture
def cpus(tmp_path):
    """CPUs 0 to 3 of two cores: 0 and 2 share one, 1 and 3 the other."""
    for cpu, siblings in enumerate(("0,2", "1,3", "0,2", "1,3")):
        folder = tmp_path / f"cpu{cpu}/topology"
        folder.mkdir(parents=True)
        (folder / "thread_siblings_list").write_text(f"{siblings}\n")
    for index, (level, kind, size, sharing) in enumerate(
        [
            ("1", "Data", "48K", "0,2"),
            ("1", "Instruction", "32K", "0,2"),
            ("3", "Unified", "32M", "0-3"),
        ]
    ):
        folder = tmp_path / f"cpu0/cache/index{index}"
        folder.mkdir(parents=True)
        for name, text in {
            "level": level,
            "type": kind,
            "size": size,
            "shared_cpu_list": sharing,
        }.items():
            (folder / name).write_text(f"{text}\n")
    return tmp_path


def test_real_cores_come_first(cpus):
    assert machine.spread([0, 1, 2, 3], cpus) == [(0, False), (1, False), (2, True), (3, True)]
    assert machine.spread([2, 3], cpus) == [
        (2, False),
        (3, False),
    ]  # nobody else uses their cores here
    assert machine.spread([2, 0], cpus) == [(0, False), (2, True)]
    assert machine.spread([7, 5], cpus / "nothing") == [(5, False), (7, False)]


def test_caches_are_named(cpus):
    assert machine.caches(cpus) == ("L1 48K for 2 CPUs", "L3 32M for 4 CPUs")
    assert machine.caches(cpus / "nothing") == ()


def test_time_of_control_groups_is_the_least_of_all_above(tmp_path):
    own = tmp_path / "own"
    own.write_text("0::/outer/inner\n")
    (tmp_path / "outer/inner").mkdir(parents=True)
    assert machine.quota(tmp_path, own) == math.inf
    (tmp_path / "outer/inner/cpu.max").write_text("max 100000\n")
    assert machine.quota(tmp_path, own) == math.inf
    (tmp_path / "outer/cpu.max").write_text("150000 100000\n")
    assert machine.quota(tmp_path, own) == 1.5
    (tmp_path / "outer/inner/cpu.max").write_text("50000 100000\n")
    assert machine.quota(tmp_path, own) == 0.5


def test_time_of_control_groups_of_the_first_version(tmp_path):
    own = tmp_path / "own"
    own.write_text("4:memory:/mine\n3:cpu,cpuacct:/mine\n")
    folder = tmp_path / "cpu/mine"
    folder.mkdir(parents=True)
    (folder / "cpu.cfs_period_us").write_text("100000\n")
    (folder / "cpu.cfs_quota_us").write_text("-1\n")
    assert machine.quota(tmp_path, own) == math.inf
    (folder / "cpu.cfs_quota_us").write_text("400000\n")
    assert machine.quota(tmp_path, own) == 4.0
    (folder / "cpu.cfs_period_us").write_text("nonsense\n")
    assert machine.quota(tmp_path, own) == math.inf


def test_threads_are_no_more_than_the_group_has_time_for(monkeypatch):
    monkeypatch.setattr(machine.os, "sched_getaffinity", lambda _: set(range(8)))
    for quota, threads in ((math.inf, 8), (16.0, 8), (4.0, 4), (2.5, 3), (0.2, 1)):
        monkeypatch.setattr(machine, "quota", lambda quota=quota: quota)
        assert machine.usable_cpus() == threads


def test_this_machine_is_described():
    here = machine.describe()
    assert 1 <= here.real_cores <= here.cores and here.width in (4, 8, 16)
    assert here.versions["jax"] and len(here.code) == 64 and bool(here.gpus) != bool(here.no_gpu)


def test_the_work_of_others_is_what_is_busy_beside_our_own(tmp_path, monkeypatch):
    stat = tmp_path / "stat"
    stat.write_text("cpu  100 5 50 9000 70 1 2 3 40 0\ncpu0 1 2\n")
    assert clock.busy_ticks(stat) == 100 + 5 + 50 + 1 + 2 + 3
    assert math.isnan(clock.busy_ticks(tmp_path / "nothing"))
    ticks, own, now = iter([0.0, 300.0]), iter([1.0, 2.0]), iter([0.0, 4.0])
    monkeypatch.setattr(clock, "busy_ticks", lambda _: next(ticks))
    monkeypatch.setattr(clock, "_own_s", lambda: next(own))
    monkeypatch.setattr(clock.time, "perf_counter", lambda: next(now))
    assert clock.Bystanders().cores() == pytest.approx((3.0 - 1.0) / 4.0)
    ticks, own, now = iter([math.nan] * 2), iter([1.0, 2.0]), iter([0.0, 4.0])
    assert math.isnan(clock.Bystanders().cores())
