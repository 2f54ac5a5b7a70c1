"""The results of a campaign, read from their folder when asked for."""

from __future__ import annotations

import pytest
import synthetic_results as synthetic

from ravenjax.store.access.results import Results
from ravenjax.store.folder import ResultFolder

RUNS = 500
FRAME = synthetic.frame(RUNS)
SHAPE = synthetic.shape()


@pytest.fixture(scope="module")
def in_folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("results")
    folder = ResultFolder.open(path, synthetic.manifest(RUNS))
    for rows in folder.missing(90):
        folder.add(FRAME.iloc[rows.start : rows.stop])
    folder.close(1.0, 1.0, RUNS)
    return Results(SHAPE, path)


def test_verdicts_are_counted_over_the_faulty_runs(in_folder):
    faulty = FRAME[FRAME["fault0_site"] != ""]
    naive = {
        verdict: faulty["verdict"].tolist().count(verdict) for verdict in set(faulty["verdict"])
    }
    assert in_folder.verdicts() == naive
    counts = list(in_folder.verdicts().values())
    assert counts == sorted(counts, reverse=True)
