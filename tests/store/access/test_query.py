"""A folder as a relation: the same table however it is cut, only what the manifest names,
nothing left behind.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
import synthetic_results as synthetic
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.errors import StoreError
from ravenjax.store import manifest as manifests
from ravenjax.store import parts
from ravenjax.store.access import query
from ravenjax.store.folder import ResultFolder, read_all

RUNS = 90
FRAME = synthetic.frame(RUNS)


def fill(path, chunk):
    folder = ResultFolder.open(path, synthetic.manifest(RUNS))
    for rows in folder.missing(chunk):
        folder.add(FRAME.iloc[rows.start : rows.stop])
    folder.close(compile_s=1.0, run_s=2.0, rows=RUNS)
    return path


@pytest.mark.slow
@settings(max_examples=5)
@given(st.integers(9, RUNS))
def test_the_relation_is_the_table_whatever_the_parts(chunk):
    with tempfile.TemporaryDirectory() as place:
        folder = fill(Path(place) / "results", chunk)
        with query.open_folder(folder) as table:
            found = table.frame('SELECT * EXCLUDE row FROM results ORDER BY "index"')
            assert table.row('SELECT count(*), bool_and(row = "index") FROM results') == (
                RUNS,
                True,
            )
        whole = read_all(folder)
        for name in whole:
            assert found[name].astype(str).tolist() == whole[name].astype(str).tolist(), name
        assert (
            sorted(path.name for path in folder.iterdir() if path.name.startswith(".query")) == []
        )


def test_parts_that_nobody_recorded_are_not_read(tmp_path):
    fill(tmp_path, 40)
    record = manifests.read(tmp_path)
    manifests.write(
        tmp_path, record.model_copy(update={"parts": record.parts[:1], "finished": None})
    )
    with query.open_folder(tmp_path) as table:
        assert table.row("SELECT count(*) FROM results") == (40,)


def test_damage_is_refused_before_a_query(tmp_path):
    fill(tmp_path, 40)
    path = parts.files(tmp_path / "parts")[1]
    content = path.read_bytes()
    path.write_bytes(content[:-10])
    with pytest.raises(StoreError, match=rf"{path}: has .* bytes"):
        query.open_folder(tmp_path)


@pytest.mark.slow
def test_what_does_not_fit_in_memory_is_spilled_and_what_cannot_be_is_told(tmp_path):
    with query.empty(tmp_path, memory_mb=60) as table:
        table.run("CREATE TABLE long AS SELECT i, hash(i) AS h FROM range(6000000) AS made(i)")
        assert table.row("SELECT count(*) FROM (SELECT h FROM long ORDER BY h)") == (6_000_000,)
    assert list(tmp_path.iterdir()) == []
    with (
        query.empty(tmp_path, memory_mb=40) as table,
        pytest.raises(StoreError, match="RAVENJAX_QUERY_MB=4000"),
    ):
        table.row("SELECT len(list(hash(i))) FROM range(20000000) AS made(i)")
