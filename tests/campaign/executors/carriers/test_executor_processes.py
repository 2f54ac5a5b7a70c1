"""Worker processes: the same table, whoever dies on the way; what always dies is named, all else
is delivered.
"""

from __future__ import annotations

import dataclasses
import functools
import os
import signal
from pathlib import Path

import deadly_pack
import pytest
import tiny_campaign as tiny

from ravenjax.campaign import plan, runner
from ravenjax.campaign.executors import remote
from ravenjax.campaign.executors.carriers import processes, worker
from ravenjax.campaign.executors.carriers.processes import Processes
from ravenjax.campaign.executors.local import Local
from ravenjax.campaign.executors.protocol import Work
from ravenjax.campaign.progress.counts import Progress
from ravenjax.engines import selection
from ravenjax.errors import UserError
from ravenjax.store import manifest, parts, schema


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The campaign's folder, computed here."""
    out = tmp_path_factory.mktemp("local")
    runner.run_campaign(tiny.config(), out, "simd")
    return out


def children() -> list[int]:
    """Process ids of the workers of this process."""
    found = []
    for path in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            if (
                parent == os.getpid()
                and b"ravenjax.campaign.executors.carriers.worker"
                in (path / "cmdline").read_bytes()
            ):
                found.append(int(path.name))
        except (OSError, IndexError):
            continue
    return found


@pytest.mark.slow
def test_two_workers_of_which_one_is_killed_make_the_same_folder(
    whole, tmp_path_factory, tmp_path, monkeypatch
):
    monkeypatch.setenv("PYTHONPATH", str(Path(deadly_pack.__file__).parent))
    told, notes = [], tmp_path_factory.mktemp("notes")
    monkeypatch.setattr(
        parts, "encode", functools.partial(deadly_pack.encode, dies={140: 1}, notes=notes)
    )
    runner.run_campaign(
        tiny.config(), tmp_path, "simd", executor=Processes(2), on_progress=told.append
    )
    assert tiny.digest(tmp_path) == tiny.digest(whole)
    names = [path.name for path in parts.files(whole / "parts")]
    assert [path.name for path in parts.files(tmp_path / "parts")] == names and len(names) == 15
    for name in names:
        assert (tmp_path / "parts" / name).read_bytes() == (whole / "parts" / name).read_bytes()
    record = manifest.read(tmp_path)
    assert (record.executor, record.workers, record.starts) == (
        "processes",
        2,
        1,
    ) and record.finished is not None
    assert (notes / "140").read_bytes() == b"xx", "killed once, then computed again"
    assert any(
        note.startswith("rows 140 to 159: worker killed by SIGKILL") for note in told[-1].notes
    )
    assert (
        told[-1].phase == "done"
        and told[-1].done == 300
        and told[-1].workers == 2
        and told[-1].parts == 15
    )
    assert not children(), "no worker outlives the campaign"


@pytest.mark.slow
@pytest.mark.parametrize("at", ["while it compiles", "while it computes"])
def test_a_worker_that_is_stopped_and_not_dead_is_noticed_and_replaced(
    whole, tmp_path, monkeypatch, at
):
    """The other worker goes on meanwhile; what the stopped one held is computed again, and the
    folder is the same.
    """
    assert processes.PATIENCE * processes.WAIT_S < 60 and processes.WAIT_S > 2 * worker.ALIVE_S
    monkeypatch.setattr(
        processes, "WAIT_S", 1.0
    )  # of six waits; a sign of life comes every two seconds
    stopped, told, notes = [], [], tmp_path / "notes"
    notes.mkdir()
    if at == "while it computes":
        monkeypatch.setenv("PYTHONPATH", str(Path(deadly_pack.__file__).parent))
        stops = functools.partial(deadly_pack.encode, dies={140: 1}, notes=notes, way="stopped")
        monkeypatch.setattr(parts, "encode", stops)

    def watch(status):
        told.append(status)
        if at == "while it compiles" and not stopped and (there := children()):
            stopped.append(there[0])
            os.kill(there[0], signal.SIGSTOP)

    runner.run_campaign(
        tiny.config(), tmp_path / "out", "simd", executor=Processes(2), on_progress=watch
    )
    assert stopped or (notes / "140").read_bytes() == b"xx"
    assert tiny.digest(tmp_path / "out") == tiny.digest(whole)
    assert any(
        "worker gave no sign of life for 6 s; tried again" in note for note in told[-1].notes
    )
    assert not children(), "the stopped worker is gone, too"


@pytest.mark.slow
def test_a_stopped_worker_does_not_hold_up_what_ends_the_work(tmp_path, monkeypatch):
    """Not even where it takes no more messages: a socket's buffer is full at once."""
    monkeypatch.setattr(processes, "WAIT_S", 1.0)
    monkeypatch.setenv("PYTHONPATH", str(Path(deadly_pack.__file__).parent))
    asked, got = work(tiny.config(runs=60), tmp_path, {}, "")
    share, stopped = remote.share, []

    def stop_and_share(ready, rows):
        if rows and (there := children()) and not stopped:
            stopped.append(there[0])
            os.kill(there[0], signal.SIGSTOP)
            return b"x" * 10_000_000
        return share(ready, rows)

    monkeypatch.setattr(remote, "share", stop_and_share)
    Processes(1).run(asked, CHUNKS)
    assert (
        stopped and sorted(rows.start for rows in got) == [0, 10, 20, 30, 40, 50] and not children()
    )


def work(config, tmp_path, dies, way):
    """A piece of work whose chunks kill, and the tables that it delivers."""
    ready = plan.make(config)
    engine = selection.select("simd", ready.program.setup.precision)
    got = {}
    pack = functools.partial(
        deadly_pack.pack, shape=runner.shape_of(ready), dies=dies, notes=tmp_path, way=way
    )
    progress = Progress("", ready.runs, ready.runs, ready.program.ticks, None)

    def deliver(done):
        assert done.rows not in got, "delivered once"
        got[done.rows] = done.packed

    return Work(ready, engine, pack, deliver, progress), got


CHUNKS = [range(start, start + 10) for start in range(0, 60, 10)]


@pytest.mark.slow
@pytest.mark.parametrize("way", ["killed", "raises"])
def test_a_chunk_that_always_kills_its_worker_is_named_and_the_others_are_delivered(
    tmp_path, monkeypatch, way
):
    monkeypatch.setenv("PYTHONPATH", str(Path(deadly_pack.__file__).parent))
    asked, got = work(tiny.config(runs=60), tmp_path, {20: 99, 40: 1}, way)
    why = {
        "killed": r"worker killed by SIGKILL \(too little memory\?\)",
        "raises": "MemoryError: no memory left",
    }
    with pytest.raises(
        UserError, match=rf"(?s)1 chunk\(s\) failed 3 times.*rows 20 to 29: {why[way]}"
    ):
        Processes(2).run(asked, CHUNKS)
    assert sorted(rows.start for rows in got) == [0, 10, 30, 40, 50]
    assert (tmp_path / "20").read_bytes() == b"xxx" and not children()


@pytest.mark.slow
def test_a_chunk_elsewhere_is_the_chunk_here(whole):
    """Rows of a share alone, through the same kernel."""
    ready = plan.make(tiny.config())
    engine = selection.select("simd", ready.program.setup.precision)
    pack = functools.partial(
        parts.encode, shape=runner.shape_of(ready), config_hash=manifest.read(whole).config_hash
    )
    progress = Progress("", 300, 300, ready.program.ticks, None)
    given = remote.head(Work(ready, engine, pack, lambda _: None, progress), [range(20)])
    assert given.ready.runs == 0
    bench = remote.Bench(given, progress)
    for rows in (range(0, 20), range(280, 300), range(140, 160)):
        done = bench.finish(*bench.compute(remote.share(ready, rows)))
        assert done.rows == rows and done.failures == {}
        assert (whole / "parts" / done.packed.part.file).read_bytes() == done.packed.content


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"code_hash": "f" * 64}, "code: .* there, ffffffffffffffff at the coordinator"),
        ({"versions": {"numpy": "1.0"}}, r"numpy: .* there, 1\.0 at the coordinator"),
        ({"device": "another (CPU)"}, "device: "),
    ],
)
def test_a_worker_that_would_compute_something_else_refuses(change, told):
    ready = plan.make(tiny.config())
    engine = selection.select("simd", ready.program.setup.precision)
    asked = Work(ready, engine, schema.conform, lambda _: None, Progress("", 1, 1, 1, None))
    given = remote.head(asked, [range(20)])
    for name, value in change.items():
        object.__setattr__(given, name, value)
    with pytest.raises(UserError, match=f"would not compute the same: .*{told}"):
        remote.Bench(given, asked.progress)


def test_kinds_of_devices_not_their_number_must_agree():
    alike = (("NVIDIA H200", "8 x NVIDIA H200"), ("2 x A", "A, 3 x B"))
    assert all(remote._kinds(here) <= remote._kinds(there) for here, there in alike)
    assert not remote._kinds("A, B") <= remote._kinds("4 x A")


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 4])
def test_the_number_of_workers_decides_nothing(whole, workers):
    table = runner.run_campaign(tiny.config(), None, "simd", executor=Processes(workers)).frame()
    assert tiny.digest(table) == tiny.digest(whole)


@pytest.mark.parametrize(
    "executor",
    [Local(), pytest.param(Processes(2), marks=pytest.mark.slow)],
    ids=lambda one: one.name,
)
def test_an_error_of_delivering_ends_the_work(tmp_path, monkeypatch, executor):
    monkeypatch.setenv("PYTHONPATH", str(Path(deadly_pack.__file__).parent))
    asked, _ = work(tiny.config(runs=60), tmp_path, {}, "")

    def refuse(_):
        raise OSError(28, "No space left on device")

    with pytest.raises(OSError, match="No space left"):
        executor.run(dataclasses.replace(asked, deliver=refuse), CHUNKS)
    assert not children()
