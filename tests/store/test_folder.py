"""Result folder: resumed, checked before work, the same whatever the parts' sizes; damage named,
nothing lost.
"""

import os

import pytest
import synthetic_results as synthetic

from ravenjax.campaign import loading
from ravenjax.campaign.runner import run_campaign
from ravenjax.errors import StoreError, UserError
from ravenjax.store import schema
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


def test_newer_schema_is_refused_politely(tmp_path):
    fill(tmp_path, chunk=40)
    path = tmp_path / "manifest.json"
    mine, newer = schema.VERSION, schema.VERSION + 1
    path.write_text(
        path.read_text().replace(f'"schema_version": {mine}', f'"schema_version": {newer}')
    )
    told = rf"manifest.json: has schema version {newer}, but this ravenjax reads {mine}.*upgrade"
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


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (
            {"config": {"duration_s": 4.0}, "config_hash": "0"},
            "config.duration_s: 3.0 here, 4.0 requested",
        ),
        ({"seed": 8}, "seed: 7 here, 8 requested"),
        ({"engine": "mjx"}, 'engine: "xla" here, "mjx" requested'),
        ({"code_hash": "f" * 64}, "code: "),
        ({"versions": {"jax": "0.1"}}, "versions.jax: "),
        ({"settings": {"XLA_FLAGS": "--a=b"}}, 'settings.XLA_FLAGS: absent here, "--a=b"'),
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


def test_a_folder_whose_name_is_not_utf8_is_refused(tmp_path):
    folder = tmp_path / os.fsdecode(b"lab\xff")
    tables = {"campaign": {"name": "x", "duration_s": 0.1}, "group": [{"name": "free"}]}
    check = {"name": "gate", "file": str(folder / "gate.py"), "at": "usb_out", "acts": "stop"}
    for more in ({"check": [check]}, {"operator": {"file": str(folder / "log.csv")}}, {}):
        with pytest.raises(UserError, match="not UTF-8; rename the file or folder"):
            run_campaign(loading.from_dict(tables | more), folder / "out")
