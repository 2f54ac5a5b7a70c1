"""Which executor, where its workers sit, which shard has which rows."""

from __future__ import annotations

import os
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.campaign.executors import shards
from ravenjax.campaign.executors.carriers import choice, placement
from ravenjax.campaign.executors.shards import Shard
from ravenjax.errors import UserError


@pytest.mark.parametrize(
    ("given", "name", "workers"),
    [
        ((), "local", 1),
        ((None, 3), "processes", 3),
        (("processes",), "processes", None),
        (("local", 1), "local", 1),
    ],
)
def test_the_executor_that_is_meant(given, name, workers):
    found = choice.executor(*given)
    assert (found.name, found.workers) == (name, workers)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        (("proceses",), "--executor 'proceses' is unknown: .*Did you mean 'processes'"),
        (("processes", 0), "--workers 0: expected 1 or more"),
        (("local", 4), "--workers 4 with --executor local.*--executor processes"),
        (("processes", 1, "a:1"), "--ray-address a:1 belongs to --executor ray"),
    ],
)
def test_an_executor_that_cannot_be_meant(given, told):
    with pytest.raises(UserError, match=told):
        choice.executor(*given)


def test_ray_is_an_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(UserError, match=r"pip install 'ravenjax\[ray\]'"):
        choice.executor("ray")


@given(st.lists(st.integers(0, 63), min_size=1, max_size=64, unique=True), st.integers(1, 70))
def test_every_worker_has_cores_of_its_own_as_long_as_there_are_enough(cpus, count):
    groups = placement.groups([sorted(cpus)], count)
    assert len(groups) == count and all(groups)
    used = [cpu for group in groups for cpu in group]
    assert set(used) <= set(cpus)
    if count <= len(cpus):
        assert sorted(used) == sorted(cpus)
        assert max(map(len, groups)) - min(map(len, groups)) <= 1
    else:
        assert max(used.count(cpu) for cpu in cpus) - min(used.count(cpu) for cpu in cpus) <= 1


def test_nodes_are_the_kernels(tmp_path):
    for node, cpus in ((0, "0-3,8\n"), (1, "4-7\n"), (10, "9\n")):
        (tmp_path / f"node{node}").mkdir()
        (tmp_path / f"node{node}" / "cpulist").write_text(cpus)
    assert placement.numa_nodes(range(1, 9), tmp_path) == [[1, 2, 3, 8], [4, 5, 6, 7]]
    assert placement.numa_nodes([3, 1], tmp_path / "none") == [[1, 3]]
    assert [cpu for node in placement.numa_nodes(os.sched_getaffinity(0)) for cpu in node]


def test_a_worker_has_a_gpu(monkeypatch):
    monkeypatch.setenv("CUDA_VISIBLE_DEVICES", "5, GPU-7")
    assert placement.visible_gpus(2) == ["5", "GPU-7"]
    monkeypatch.delenv("CUDA_VISIBLE_DEVICES")
    named = [
        seat.environment["CUDA_VISIBLE_DEVICES"]
        for seat in placement.seats(None, placement.visible_gpus(3))
    ]
    assert named == ["0", "1", "2"]
    assert all(not seat.environment for seat in placement.seats(2, []))


@given(st.integers(1, 12), st.integers(1, 5000), st.integers(1, 700))
def test_shards_hold_every_row_once_and_about_as_many_each(of, runs, chunk):
    held = [Shard(number, of).rows(runs, chunk) for number in range(1, of + 1)]
    rows = sorted(row for some in held for rows in some for row in rows)
    assert rows == list(range(runs))
    counts = [sum(map(len, some)) for some in held]
    assert max(counts) - min(counts) <= chunk


@given(st.integers(1, 64), st.integers(1, 10**8))
def test_the_chunk_shares_a_large_campaign_out_evenly(of, runs):
    chunk = Shard(1, of).chunk(runs, 65_536)
    assert 1 <= chunk <= 65_536 and chunk == Shard(of, of).chunk(runs, 65_536)
    if runs >= shards.CHUNKS * of * shards.FEWEST_ROWS:
        assert -(-runs // chunk) >= (shards.CHUNKS - 1) * of


@pytest.mark.parametrize("text", ["", "3", "0/3", "4/3", "1/0", "a/b", "-1/3", "1/3/5"])
def test_no_shard(text):
    with pytest.raises(UserError, match="expected i/N with 1 <= i <= N"):
        shards.parse(text)


def test_a_shard():
    assert shards.parse(" 2/7 ") == Shard(2, 7) and str(Shard(2, 7)) == "2/7"
    assert Shard(2, 7).folder == "shard-2-of-7"
