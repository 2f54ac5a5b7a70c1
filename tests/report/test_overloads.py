"""The report's table of overloaded cables, against plain pandas."""

import dataclasses

import numpy as np
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import tables

RUNS = 1200
SHAPE = dataclasses.replace(synthetic.shape(), stages=("overload",))
MANIFEST = synthetic.manifest(RUNS, shape=SHAPE)
PLAIN = synthetic.frame(RUNS)
OVER = (PLAIN["fault0_site"].to_numpy() != "") & (np.arange(RUNS) % 3 == 0)
FRAME = PLAIN.assign(
    cable_load=np.where(OVER, 1.4, 0.3).astype(np.float32),
    cable_overload_first_ms=np.where(OVER, PLAIN["fault0_start_ms"] + 9, -1),
    cable_overload=np.where(OVER, "gold " + PLAIN["fault0_channel"].astype(str), ""),
    golden_cable_load=np.float32(0.1),
    golden_cable_overload_first_ms=np.where(
        np.arange(RUNS) % 6 == 0, 1, -1
    ),  # of half of them the golden run's, too
)
ROWS = tables.overload_rows(Runs.of(FRAME, MANIFEST))


def test_every_site_by_pandas():
    valid = FRAME[(FRAME["fault0_site"] != "") & (FRAME["failed"] == "")]
    own = valid["cable_overload_first_ms"].to_numpy() >= 0
    beyond = own & ~(valid["golden_cable_overload_first_ms"].to_numpy() == 1)
    assert 0 < beyond.sum() < own.sum()
    sites = valid["fault0_site"][beyond].unique()
    assert ROWS[0].site == tables.EVERY_SITE and sorted(row.site for row in ROWS[1:]) == sorted(
        sites
    )
    for row in ROWS:
        here = (
            np.ones(len(valid), bool)
            if row.site == tables.EVERY_SITE
            else (valid["fault0_site"] == row.site).to_numpy()
        )
        both = here & beyond
        assert (row.faults, row.overloaded.k, row.overloaded.n) == (
            here.sum(),
            both.sum(),
            here.sum(),
        )
        assert row.unintended == (both & (valid["hazard"] == "unintended motion").to_numpy()).sum()
        names = valid["cable_overload"][both].value_counts()
        assert names[row.cable] == names.max()
        assert row.load == np.float32(1.4)
