"""What a start computes and what it tells: limits, shards, one writer, progress for
whoever watches.
"""

import json
import os

import pytest
import tiny_campaign as tiny

from ravenjax.campaign import runner
from ravenjax.campaign.executors.shards import Shard
from ravenjax.campaign.progress import Status
from ravenjax.errors import StoreError
from ravenjax.store import manifest, parts
from ravenjax.store.access import lock
from ravenjax.store.folder import read_all


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("whole")
    told: list[Status] = []
    runner.run_campaign(
        tiny.config(),
        out,
        "simd",
        on_progress=told.append,
        command=["ravenjax", "run", "tiny.toml"],
    )
    return out, told


def limited(limit):
    config = tiny.config()
    return config.model_copy(
        update={"campaign": config.campaign.model_copy(update={"limit": limit})}
    )


@pytest.mark.slow
def test_a_limited_run_goes_on_to_more_and_to_all(whole, tmp_path):
    """A limit says how far to compute, not which campaign it is."""
    table = runner.run_campaign(limited(64), tmp_path, "simd").frame()
    first = manifest.read_manifest(tmp_path)
    assert table["index"].tolist() == list(range(64)) and first.finished is not None
    assert (first.runs, first.due, first.rows) == (
        300,
        64,
        ((0, 63),),
    ) and "limit" not in first.config["campaign"]
    before = {path: path.stat().st_mtime_ns for path in parts.part_files(tmp_path / "parts")}
    assert len(runner.run_campaign(limited(100), tmp_path, "simd").frame()) == 100
    assert len(runner.run_campaign(limited(5), tmp_path, "simd").frame()) == 100, (
        "fewer ask for nothing"
    )
    runner.run_campaign(tiny.config(), tmp_path, "simd")
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert tiny.digest(tmp_path) == tiny.digest(whole[0])
    last, expected = manifest.read_manifest(tmp_path), manifest.read_manifest(whole[0])
    assert last.differences(expected) == [] and last.rows is None and last.done == 300


def test_a_shard_has_its_rows_and_says_so(whole, tmp_path):
    expected = read_all(whole[0])
    for number in (1, 2):
        out = tmp_path / f"{number}"
        runner.run_campaign(tiny.config(), out, "simd", shard=Shard(number, 2))
        rows = [row for row in range(300) if row // 20 % 2 == number - 1]
        assert read_all(out)["run_id"].tolist() == expected["run_id"].iloc[rows].tolist()
        record = manifest.read_manifest(out)
        assert (
            record.shard == f"{number}/2"
            and [row for some in record.wanted for row in some] == rows
        )
        for path in parts.part_files(out / "parts"):
            assert path.read_bytes() == (whole[0] / "parts" / path.name).read_bytes(), (
                "the very parts of the whole"
            )
    with pytest.raises(StoreError, match='shard: "2/2" here, null requested'):
        runner.run_campaign(tiny.config(), tmp_path / "2", "simd")


def test_a_folder_that_is_being_written_to_is_left_alone(tmp_path):
    with (
        lock.hold_lock(tmp_path),
        pytest.raises(StoreError, match=f"process {os.getpid()} on .* is writing"),
    ):
        runner.run_campaign(tiny.config(), tmp_path, "simd")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".lock"]


def test_the_progress_file_tells_what_the_watcher_was_told(whole):
    out, told = whole
    found = json.loads((out / "progress.json").read_text())
    names = "phase done total eta_s runs_per_s failed workers started updated"
    first = [found[name] for name in names.split()][:4]
    assert first == ["done", 300, 300, 0.0]
    assert found["pid"] == os.getpid() and found["parts"] == told[-1].parts
