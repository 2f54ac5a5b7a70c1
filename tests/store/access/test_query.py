"""A folder as a relation: the same table however it is cut, only what the manifest names,
nothing left behind.
"""

import tempfile
from pathlib import Path

import pytest
import synthetic_results as synthetic
from hypothesis import given, settings
from hypothesis import strategies as st

from ravenjax.errors import StoreError
from ravenjax.store.access import query
from ravenjax.store.folder import read_all

RUNS = 90
FRAME = synthetic.frame(RUNS)


@pytest.mark.slow
@settings(max_examples=5)
@given(st.integers(9, RUNS))
def test_the_relation_is_the_table_whatever_the_parts(chunk):
    with tempfile.TemporaryDirectory() as place:
        folder = synthetic.folder(Path(place) / "results", FRAME, synthetic.manifest(RUNS), chunk)
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


@pytest.mark.slow
def test_what_does_not_fit_in_memory_is_spilled_and_what_cannot_be_is_told(tmp_path):
    with query.open_empty(tmp_path, memory_mb=60) as table:
        table.run("CREATE TABLE long AS SELECT i, hash(i) AS h FROM range(6000000) AS made(i)")
        assert table.row("SELECT count(*) FROM (SELECT h FROM long ORDER BY h)") == (6_000_000,)
    assert list(tmp_path.iterdir()) == []
    with (
        query.open_empty(tmp_path, memory_mb=40) as table,
        pytest.raises(StoreError, match="RAVENJAX_QUERY_MB=4000"),
    ):
        table.row("SELECT len(list(hash(i))) FROM range(20000000) AS made(i)")
