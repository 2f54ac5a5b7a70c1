"""The report's table of overloaded cables, against plain pandas."""

from __future__ import annotations

import dataclasses

import numpy as np
import synthetic_results as synthetic

from ravenjax.report import page
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import overloads

RUNS = 1200
SHAPE = dataclasses.replace(synthetic.shape(), cables=True)
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
ROWS = overloads.rows(Runs.of(FRAME, MANIFEST), MANIFEST)


def test_every_site_by_pandas():
    valid = FRAME[(FRAME["fault0_site"] != "") & (FRAME["failed"] == "")]
    own = valid["cable_overload_first_ms"].to_numpy() >= 0
    beyond = own & ~(valid["golden_cable_overload_first_ms"].to_numpy() == 1)
    assert 0 < beyond.sum() < own.sum()
    sites = valid["fault0_site"][beyond].unique()
    assert ROWS[0].site == overloads.ALL and sorted(row.site for row in ROWS[1:]) == sorted(sites)
    for row in ROWS:
        here = (
            np.ones(len(valid), bool)
            if row.site == overloads.ALL
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


def test_the_page_says_so_where_tensions_are_known(tmp_path):
    html = page.render(Runs.of(FRAME, MANIFEST), MANIFEST, tmp_path)
    assert (
        "Overloaded cables" in html
        and "overloaded cable</dt>" in html
        and "held all the same" in html
    )
    quiet = FRAME.assign(cable_overload_first_ms=-1, cable_overload="", cable_load=np.float32(0.3))
    html = page.render(Runs.of(quiet, MANIFEST), MANIFEST, tmp_path)
    assert "golden run. None was." in html and "held all the same" not in html
    plain = synthetic.manifest(RUNS)
    without = page.render(Runs.of(PLAIN, plain), plain, tmp_path)
    assert "verloaded cable" not in without
    assert overloads.rows(Runs.of(PLAIN, plain), plain) == []
