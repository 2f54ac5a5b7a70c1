"""Executor `ray`: the same table from two nodes of which one goes away on the way."""

import contextlib
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import snippets
import tiny_campaign as tiny
import waiting

ray = pytest.importorskip("ray")

from ray.cluster_utils import Cluster  # noqa: E402

from ravenjax.campaign import runner  # noqa: E402
from ravenjax.campaign.executors import ray_cluster  # noqa: E402
from ravenjax.campaign.executors.protocol import Work  # noqa: E402
from ravenjax.campaign.plan import make_plan  # noqa: E402
from ravenjax.campaign.progress import Progress  # noqa: E402
from ravenjax.engines import selection  # noqa: E402
from ravenjax.errors import UserError  # noqa: E402
from ravenjax.store import parts  # noqa: E402

SIZE = {"runs": 2000, "chunk": 20, "duration_s": 0.3}

pytestmark = pytest.mark.slow


@pytest.fixture
def cluster():
    """A head node without cores for tasks, and two nodes of one core each."""
    made = Cluster(initialize_head=True, head_node_args={"num_cpus": 0, "include_dashboard": False})
    nodes = [made.add_node(num_cpus=1) for _ in range(2)]
    yield made, nodes
    ray.shutdown()
    made.shutdown()


def test_two_nodes_of_which_one_is_killed_make_the_same_folder(cluster, tmp_path):
    made, nodes = cluster
    runner.run_campaign(tiny.config(**SIZE), tmp_path / "here", "simd")
    killed, told = [], []

    def kill_one(status):
        told.append(status)
        if status.parts >= 5 and not killed:
            killed.append(nodes[0])
            made.remove_node(nodes[0], allow_graceful=False)

    there = tmp_path / "there"
    ran = ray_cluster.Ray(2, made.address)
    runner.run_campaign(tiny.config(**SIZE), there, "simd", executor=ran, on_progress=kill_one)
    assert killed and told[-1].workers == 2 and told[-1].done == SIZE["runs"]
    assert tiny.digest(there) == tiny.digest(tmp_path / "here")
    for path in parts.part_files(tmp_path / "here" / "parts"):
        assert (there / "parts" / path.name).read_bytes() == path.read_bytes()


def tasks() -> list[int]:
    """Process ids of the workers that compute a chunk."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            if (path / "cmdline").read_bytes().startswith(b"ray::_compute"):
                found.append(int(path.name))
    return found


@pytest.mark.parametrize("how", [signal.SIGKILL, signal.SIGSTOP], ids=["killed", "stopped"])
def test_workers_that_die_or_hang_are_replaced(cluster, tmp_path, monkeypatch, how):
    made, _ = cluster
    monkeypatch.setattr(ray_cluster, "MAX_CHUNK_S", 20.0)
    runner.run_campaign(tiny.config(**SIZE), tmp_path / "here", "simd")
    ended, times = [], 3 if how == signal.SIGKILL else 1

    def end(status):
        if status.parts >= 5 * (len(ended) + 1) and len(ended) < times and (there := tasks()):
            ended.append(there[0])
            with contextlib.suppress(ProcessLookupError):
                os.kill(there[0], how)

    ran = ray_cluster.Ray(2, made.address)
    runner.run_campaign(
        tiny.config(**SIZE), tmp_path / "there", "simd", executor=ran, on_progress=end
    )
    assert len(ended) == times and tiny.digest(tmp_path / "there") == tiny.digest(tmp_path / "here")


@pytest.mark.parametrize("way", ["is killed", "raises"])
def test_a_chunk_that_always_fails_is_named_and_the_others_are_delivered(cluster, way):
    def pack(columns):
        if columns["index"][0] == 20:
            if way == "is killed":
                os.kill(os.getpid(), signal.SIGKILL)
            raise MemoryError("no memory left")
        return len(columns["index"])

    made, _ = cluster
    plan = make_plan(tiny.config(runs=60))
    engine = selection.select_engine("simd", plan.program.setup.precision)
    delivered = []
    progress = Progress("", 60, 60, plan.program.ticks, None)
    work = Work(plan, engine, pack, delivered.append, progress)
    why = {"is killed": "WorkerCrashedError", "raises": "MemoryError: no memory left"}[way]
    with pytest.raises(
        UserError, match=rf"(?s)1 chunk\(s\) of runs failed; .*rows 20 to 29: {why}"
    ):
        ray_cluster.Ray(2, made.address).run(work, [range(r, r + 10) for r in range(0, 60, 10)])
    assert sorted(done.rows.start for done in delivered) == [0, 10, 30, 40, 50]


def test_an_address_where_nobody_answers():
    with pytest.raises(UserError, match=r"--ray-address 127\.0\.0\.1:1: no Ray cluster answers"):
        runner.run_campaign(tiny.config(), None, "simd", executor=ray_cluster.Ray(1, "127.0.0.1:1"))


def test_the_documented_commands_start_a_cluster_that_may_change(tmp_path, monkeypatch):
    """One machine is killed on the way, and one is added, which computes the rest."""
    page = (snippets.ROOT / "docs" / "how-to" / "many-machines.md").read_text(encoding="utf-8")
    (block,) = (text for text in snippets.blocks(page, "text") if "ray start" in text)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = str(free.getsockname()[1])
    block = re.sub("FIRST|SECOND", "127.0.0.1", re.sub(r" *#.*", "", block)).replace("6379", port)
    mode, token, head, second, run, _ = block.splitlines()
    monkeypatch.setenv(*mode.removeprefix("export ").split("="))
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("PATH", str(Path(sys.executable).parent), prepend=os.pathsep)
    subprocess.run(shlex.split(token), check=True)
    with contextlib.ExitStack() as ended:

        def start(command, cores):
            words = [*shlex.split(command), "--block", "--num-cpus", str(cores)]
            node = subprocess.Popen(words, start_new_session=True)
            ended.callback(kill, node)
            return node

        def kill(node):
            with contextlib.suppress(ProcessLookupError):
                os.killpg(node.pid, signal.SIGKILL)
            node.wait()

        start(head, 0)
        first = start(second, 1)
        tiny.file(tmp_path, **SIZE).rename(tmp_path / "big.toml")
        there = tmp_path / "there"
        words = [*shlex.split(run), "--out", str(there), "--no-report"]
        command = subprocess.Popen([sys.executable, "-m", "ravenjax.cli", *words[1:]], cwd=tmp_path)
        listed = there / "parts.jsonl"
        waiting.until(lambda: listed.is_file() and listed.read_text().count("\n") >= 5)
        kill(first)
        start(second, 1)
        assert command.wait(300) == 0
    runner.run_campaign(tiny.config(**SIZE), tmp_path / "here", "simd")
    assert tiny.digest(there) == tiny.digest(tmp_path / "here")
