"""What a campaign hands back: the same table from memory and from a folder, read when asked for."""

from __future__ import annotations

import pandas as pd
import pytest
import synthetic_results as synthetic

from ravenjax.store import schema
from ravenjax.store.access.results import Results
from ravenjax.store.folder import ResultFolder

RUNS = 500
FRAME = synthetic.frame(RUNS)
SHAPE = synthetic.shape()


@pytest.fixture(scope="module")
def in_memory():
    parts = [schema.conform(FRAME.iloc[i : i + 70], SHAPE) for i in range(0, RUNS, 70)]
    return Results(SHAPE, None, parts)


@pytest.fixture(scope="module")
def in_folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("results")
    folder = ResultFolder.open(path, synthetic.manifest(RUNS))
    for rows in folder.missing(90):
        folder.add(FRAME.iloc[rows.start : rows.stop])
    folder.close(1.0, 1.0, RUNS)
    return Results(SHAPE, path)


def test_folder_and_memory_hold_the_same_table(in_memory, in_folder):
    pd.testing.assert_frame_equal(in_memory.frame(), in_folder.frame())
    pd.testing.assert_frame_equal(in_memory.frame(["seed"]), in_folder.frame(["seed"]))


def test_verdicts_are_counted_over_the_faulty_runs(in_memory, in_folder):
    faulty = FRAME[FRAME["fault0_site"] != ""]
    naive = {
        verdict: faulty["verdict"].tolist().count(verdict) for verdict in set(faulty["verdict"])
    }
    assert in_memory.verdicts() == in_folder.verdicts() == naive
    counts = list(in_memory.verdicts().values())
    assert counts == sorted(counts, reverse=True)
