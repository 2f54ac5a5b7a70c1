"""Result folder: resumed, checked before work, the same whatever the parts' sizes; damage named,
nothing lost.
"""

from __future__ import annotations

import os

import pandas as pd
import pytest
import synthetic_results as synthetic

from ravenjax.errors import StoreError
from ravenjax.store import manifest as manifests
from ravenjax.store import parts, schema
from ravenjax.store.folder import ResultFolder, read_all

RUNS = 100
FRAME = synthetic.frame(RUNS)


def wanted(**changes):
    return synthetic.manifest(RUNS, **changes)


def fill(path, chunk, stop_after=RUNS):
    folder = ResultFolder.open(path, wanted())
    for rows in folder.missing(chunk):
        if rows.start >= stop_after:
            break
        folder.add(FRAME.iloc[rows.start : rows.stop])
    folder.close(compile_s=1.0, run_s=2.0, rows=RUNS)
    return folder


def a_part(path):
    return parts.files(path / "parts")[1]


def test_round_trip_keeps_every_value(tmp_path):
    fill(tmp_path, chunk=30)
    got = read_all(tmp_path)
    assert list(got.columns) == [c.name for c in schema.columns(synthetic.shape())]
    expected = schema.conform(FRAME, synthetic.shape()).to_pandas()
    pd.testing.assert_frame_equal(got, expected, check_categorical=False)


@pytest.mark.parametrize("end", [b'{"file":"part-0000', b"\0" * 300, b'{"file":1}\n', b"\n\n"])
def test_a_torn_line_is_no_record_and_harms_no_other(tmp_path, end):
    folder = ResultFolder.open(tmp_path, wanted())
    for rows in folder.missing(40):
        folder.add(FRAME.iloc[rows.start : rows.stop])
    path = tmp_path / "parts.jsonl"
    lines = path.read_bytes().splitlines(keepends=True)
    path.write_bytes(b"".join(lines[:2]) + end)
    assert [part.first for part in manifests.read(tmp_path).parts] == [0, 40]
    assert [part.first for part in fill(tmp_path, chunk=40).manifest.parts] == [0, 40, 80]
    assert path.read_bytes() == b"".join(lines)


def test_lost_part_is_computed_again(tmp_path):
    fill(tmp_path, chunk=40)
    a_part(tmp_path).unlink()
    with pytest.raises(StoreError, match="missing"):
        read_all(tmp_path)
    folder = ResultFolder.open(tmp_path, wanted())
    assert list(folder.missing(1000)) == [range(40, 80)] and folder.manifest.finished is None
    assert len(read_all(tmp_path)) == RUNS - 40


# --- rows of their own
# ------------------------------------------------------------------------------------------------


# --- damage ---------------------------------------------------------------------------------------
# --------------------


def test_newer_schema_is_refused_politely(tmp_path):
    fill(tmp_path, chunk=40)
    path = tmp_path / "manifest.json"
    mine, newer = schema.VERSION, schema.VERSION + 1
    path.write_text(
        path.read_text().replace(f'"schema_version": {mine}', f'"schema_version": {newer}')
    )
    told = (
        rf"manifest.json: has result schema {newer}; this ravenjax reads {mine}.*is fine.*upgrade"
    )
    with pytest.raises(StoreError, match=told):
        read_all(tmp_path)


@pytest.mark.parametrize("text", ["{", "[]", f'{{"schema_version": {schema.VERSION}}}'])
def test_damaged_manifest_is_named_and_parts_survive_without_it(tmp_path, text):
    fill(tmp_path, chunk=40)
    path = tmp_path / "manifest.json"
    path.write_text(text)
    with pytest.raises(StoreError, match=r"manifest.json: .*move this file away"):
        read_all(tmp_path)
    path.unlink()
    assert ResultFolder.open(tmp_path, wanted()).manifest.done == RUNS


# --- checks before work
# -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"config": {"duration_s": 4.0}, "config_hash": "0"},
            "config.duration_s: 3.0 here, 4.0 asked for",
        ),
        ({"seed": 8}, "seed: 7 here, 8 asked for"),
        ({"engine": "mjx"}, 'engine: "xla" here, "mjx" asked for'),
        ({"code_hash": "f" * 64}, "code: "),
        ({"versions": {"jax": "0.1"}}, "versions.jax: "),
    ],
)
def test_folder_of_another_campaign_is_refused_with_what_differs(tmp_path, changes, told):
    fill(tmp_path, chunk=40)
    before = {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()}
    with pytest.raises(StoreError) as caught:
        ResultFolder.open(tmp_path, wanted(**changes))
    message = str(caught.value)
    assert told in message and "100 of 100 runs" in message and f"rm -r {tmp_path}" in message
    assert {p: p.read_bytes() for p in tmp_path.rglob("*") if p.is_file()} == before


def test_output_folder_that_refuses_files(tmp_path):
    (tmp_path / "file").write_text("in the way")
    for place in (tmp_path / "file", tmp_path / "file" / "below"):
        with pytest.raises(StoreError, match=r"cannot be written to .*name another one with --out"):
            ResultFolder.open(place, wanted())


def test_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    folder = fill(tmp_path, chunk=40)
    before = {
        tmp_path / name: (tmp_path / name).read_bytes() for name in ("manifest.json", "parts.jsonl")
    }

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(
        StoreError, match=r"parts.jsonl: cannot be written \(No space left on device\)"
    ):
        manifests.write(tmp_path, folder.manifest)
    assert {p: p.read_bytes() for p in before} == before
    assert [p.name for p in tmp_path.iterdir() if p.name.startswith(".")] == []
