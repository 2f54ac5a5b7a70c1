"""Which executor, which shard has which rows, and what a process must have in common with the
coordinator.
"""

import functools
import sys

import pytest
import tiny_campaign as tiny
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.campaign.executors import choose_executor, ray_cluster, shards
from ravenjax.campaign.executors.protocol import Local, Work, finish_chunk
from ravenjax.campaign.executors.shards import Shard
from ravenjax.campaign.plan import make_plan
from ravenjax.campaign.progress import Progress
from ravenjax.engines import selection
from ravenjax.errors import UserError
from ravenjax.store import parts

CHUNKS = [range(start, start + 10) for start in range(0, 60, 10)]


@pytest.mark.parametrize(
    ("arguments", "name", "workers"),
    [((), "local", 1), (("local", 1), "local", 1), ((None, 3), "ray", 3), (("ray",), "ray", None)],
)
def test_the_executor_that_is_meant(arguments, name, workers):
    if name == "ray":
        pytest.importorskip("ray")
    executor = choose_executor(*arguments)
    assert (type(executor).__name__.lower(), executor.workers) == (name, workers)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("locl",), "--executor: unknown executor 'locl', .*Did you mean 'local'"),
        (("ray", 0), "--workers is 0, expected 1 or more"),
        (("local", 4), "--workers 4 has no use with --executor local.*--executor ray"),
        (("local", 1, "a:1"), "--ray-address a:1 needs --executor ray"),
    ],
)
def test_an_executor_that_cannot_be_meant(arguments, message):
    with pytest.raises(UserError, match=message):
        choose_executor(*arguments)


def test_ray_is_an_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(UserError, match=r"pip install 'ravenjax\[ray\]'"):
        choose_executor("ray")


@given(st.integers(1, 12), st.integers(1, 5000), st.integers(1, 700))
def test_shards_hold_every_row_once_and_about_as_many_each(of, runs, chunk):
    held = [Shard(number, of).rows(runs, chunk) for number in range(1, of + 1)]
    rows = sorted(row for some in held for rows in some for row in rows)
    assert rows == list(range(runs))
    counts = [sum(map(len, some)) for some in held]
    assert max(counts) - min(counts) <= chunk


@pytest.mark.parametrize("text", ["", "3", "0/3", "4/3", "1/0", "a/b", "-1/3", "1/3/5"])
def test_no_shard(text):
    with pytest.raises(UserError, match="expected i/N with 1 <= i <= N"):
        shards.parse_shard(text)


def test_a_shard():
    assert shards.parse_shard(" 2/7 ") == Shard(2, 7) and str(Shard(2, 7)) == "2/7"
    assert Shard(2, 7).folder == "shard-2-of-7"


@pytest.fixture(scope="module")
def work():
    plan = make_plan(tiny.config(runs=60))
    engine = selection.select_engine("simd", plan.program.setup.precision)
    pack = functools.partial(parts.encode_part, shape=plan.shape, config_hash="tiny")
    return Work(plan, engine, pack, lambda _: None, Progress("", 60, 60, plan.program.ticks, None))


def test_a_chunk_elsewhere_is_the_chunk_here(work):
    """Rows of a chunk alone, through the same kernel."""
    here = {}
    Local().run(work._replace(deliver=lambda done: here.update({done.rows: done})), CHUNKS)
    head = ray_cluster.make_head(work, CHUNKS, 1)
    assert head.plan.runs == 0
    worker = ray_cluster.Worker(head)
    for rows in (CHUNKS[0], CHUNKS[-1], CHUNKS[3]):
        fields = work.plan.row_fields(slice(rows.start, rows.stop))
        there = finish_chunk(*worker.compute(fields), work.pack)
        assert there.rows == rows and there.failures == here[rows].failures
        assert there.packed.content == here[rows].packed.content


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("code", "ffff", "code: .* on the worker, ffff on the machine"),
        ("device", "another", "device: .* on the worker, another on the machine"),
    ],
)
def test_a_worker_that_would_compute_something_else_refuses(work, name, value, message):
    head = ray_cluster.make_head(work, CHUNKS, 1)
    head = head._replace(computed_by={**head.computed_by, name: value})
    with pytest.raises(UserError, match=f"would compute other results: .*{message}"):
        ray_cluster.Worker(head)
