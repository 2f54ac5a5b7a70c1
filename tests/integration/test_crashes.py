"""Campaigns that are killed, run out of disk, are started twice or told to stop: what is finished
is kept, the same command goes on, and the table is that of a campaign that nobody disturbed."""

import json
import os
import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import tiny_campaign as tiny
import waiting

from ravenjax.campaign import runner
from ravenjax.cli import USER_ERROR
from ravenjax.store import manifest
from ravenjax.store.access import merging

DRIVER = Path(__file__).with_name("killing_driver.py")
SIZE = {"runs": 100_000, "chunk": 100, "duration_s": 0.3}
"""More parts than fifty kills leave behind."""
SMALL = {"runs": 3_000, "chunk": 50, "duration_s": 0.3}


def command(file: Path, out: Path, *more: object) -> list[str]:
    return [
        sys.executable,
        "-m",
        "ravenjax.cli",
        "run",
        str(file),
        "--out",
        str(out),
        "--engine",
        "simd",
        "--no-report",
        *map(str, more),
    ]


HEARING = (
    "import os, signal, sys; [signal.signal(n, signal.SIG_DFL) for n in (signal.SIGINT,"
    " signal.SIGHUP)];os.execv(sys.executable, [sys.executable, *sys.argv[1:]])"
)
"""Signals are as at a terminal, also where the tests run in the background or under nohup, which
ignore some.
"""


def started(file: Path, out: Path) -> subprocess.Popen[str]:
    hearing = [sys.executable, "-c", HEARING, *command(file, out)[1:]]
    return subprocess.Popen(hearing, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def until(condition, process: subprocess.Popen[str]) -> None:
    """Wait for a condition while a process lives."""
    waiting.until(lambda: condition() or process.poll() is not None)
    assert condition(), process.communicate()


def stored(out: Path) -> list[Path]:
    return sorted(out.glob("parts/part-*.parquet"))


def finish(file: Path, out: Path) -> str:
    """What the same command prints that computes the rest."""
    done = subprocess.run(
        command(file, out), capture_output=True, text=True, check=False, timeout=waiting.DEADLINE_S
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def undisturbed(folder: Path, **size) -> str:
    """Digest of the table of a campaign that nobody disturbed."""
    return tiny.digest(runner.run_campaign(tiny.config(**size), folder, "simd").frame())


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """File of a campaign, and the digest of its table."""
    folder = tmp_path_factory.mktemp("small")
    return tiny.file(folder, **SMALL), undisturbed(folder / "whole", **SMALL)


@pytest.mark.slow
def test_fifty_kills_lose_nothing_and_do_nothing_twice(tmp_path):
    file, out = tiny.file(tmp_path, **SIZE), tmp_path / "out"
    told = subprocess.run(
        [sys.executable, str(DRIVER), str(file), str(out), "2016", "50"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert told.returncode == 0, told.stdout + told.stderr
    left = json.loads(told.stdout.splitlines()[-1])
    assert len(left) == 50 and left == sorted(left) and len(set(left)) > 20, (
        "most kills hit it while it stored parts"
    )
    before = {path: path.stat().st_mtime_ns for path in stored(out)}
    assert len(before) == left[-1] < SIZE["runs"] // SIZE["chunk"]
    finish(file, out)
    assert {path: path.stat().st_mtime_ns for path in before} == before, (
        "finished parts are left alone"
    )
    record = manifest.read_manifest(out)
    assert (
        record.done == SIZE["runs"] == sum(len(part.rows) for part in record.parts)
        and record.finished is not None
    )
    assert not (out / "set-aside").exists(), "no kill left half a part"
    assert not list(out.rglob(".*.tmp"))
    assert tiny.digest(out) == undisturbed(tmp_path / "whole", **SIZE)


@pytest.mark.slow
@pytest.mark.parametrize(
    "number", [signal.SIGTERM, signal.SIGHUP, signal.SIGINT], ids=lambda one: one.name
)
def test_a_signal_ends_it_cleanly(small, tmp_path, number):
    file, whole = small
    process = started(file, tmp_path)
    until(lambda: len(stored(tmp_path)) > 2, process)
    process.send_signal(number)
    out, err = process.communicate(timeout=waiting.DEADLINE_S)
    assert process.returncode == 128 + number, out + err
    assert (
        "finished results are kept, and the same command continues" in err.replace("\n", " ")
        and "Traceback" not in err
    )
    there = len(stored(tmp_path))
    record, told = (
        manifest.read_manifest(tmp_path),
        json.loads((tmp_path / "progress.json").read_text()),
    )
    assert (
        2 < there == len(record.parts) < SMALL["runs"] // SMALL["chunk"] and record.finished is None
    )
    assert told["phase"] == "stopped" and told["done"] == record.done
    finish(file, tmp_path)
    assert tiny.digest(tmp_path) == whole


@pytest.fixture
def tiny_disk(tmp_path):
    """A file system of 1 MiB, and a function that makes it larger."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(disk)]
    if os.geteuid() or subprocess.run(mount, capture_output=True, check=False).returncode:
        pytest.skip("a file system may not be mounted here")
    yield disk, lambda: subprocess.run(["mount", "-o", "remount,size=200m", str(disk)], check=True)
    subprocess.run(["umount", "-l", str(disk)], check=True)


@pytest.mark.slow
def test_a_full_disk_keeps_what_was_written(small, tiny_disk):
    (file, whole), (disk, enlarge) = small, tiny_disk
    out = disk / "out"
    process = started(file, out)
    printed, err = process.communicate(timeout=waiting.DEADLINE_S)
    told = err.replace("\n", " ")
    assert process.returncode == USER_ERROR and "Traceback" not in err, printed + err
    assert re.search(rf"{out}/\S+: cannot be written \(No space left on device\)", told), told
    assert "Free space" in told and "same command again" in told
    kept = {path: path.read_bytes() for path in stored(out)}
    assert 2 < len(kept) < SMALL["runs"] // SMALL["chunk"]
    enlarge()
    finish(file, out)
    assert {path: path.read_bytes() for path in kept} == kept
    assert tiny.digest(out) == whole and not (out / "set-aside").exists()


WITHOUT_LOCKS = (
    "import errno, fcntl, sys\n"
    "def refuse(*_): raise OSError(errno.ENOLCK, 'No locks available')\n"
    "fcntl.flock = refuse\n"
    "import time\n"
    "from ravenjax.cli import main\n"
    "from ravenjax.store import parts\n"
    "put = parts.put_part\n"
    "def slowly(*some): time.sleep(0.05); return put(*some)\n"
    "parts.put_part = slowly\n"
    "sys.exit(main(sys.argv[1:]))"
)
"""The command line on a file system that offers no locks, as one does that has lost them, and that
is slow: a run is still writing when it is stopped."""


@pytest.mark.slow
def test_shards_that_are_killed_in_a_folder_without_locks_lose_nothing(small, tmp_path):
    """The words in the lock file of a killed process name nobody who lives; those of one that
    lives are heeded.
    """
    file, whole = small
    folders = [tmp_path / f"{number}" for number in (1, 2)]

    def begun(number):
        line = command(file, folders[number - 1], "--shard", f"{number}/2")[3:]
        return subprocess.Popen(
            [sys.executable, "-c", WITHOUT_LOCKS, *line],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    for kill in range(3):
        shards = [begun(number) for number in (1, 2)]
        for folder, shard in zip(folders, shards, strict=True):
            until(lambda folder=folder, least=2 * (kill + 1): len(stored(folder)) > least, shard)
            shard.send_signal(signal.SIGSTOP)
        if kill == 0:  # the first lives until another has asked
            second = begun(1)
            _, err = second.communicate(timeout=waiting.DEADLINE_S)
            assert second.returncode == USER_ERROR and f"process {shards[0].pid} on" in err.replace(
                "\n", " "
            )
        for shard in shards:
            shard.kill()
            shard.communicate()
    for number in (1, 2):
        shard = begun(number)
        printed, err = shard.communicate(timeout=waiting.DEADLINE_S)
        assert shard.returncode == 0, printed + err
    merging.merge_shards(tmp_path / "joined", folders)
    assert tiny.digest(tmp_path / "joined") == whole
