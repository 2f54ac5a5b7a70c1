"""Risk tables of rows made by hand."""

import math
import tomllib

import numpy as np
import pandas as pd
import pytest
import result_rows

from ravenjax.hazards import library
from studies.hazards import library as risk
from studies.hazards.library import Pool

JUMPS = {"jump_tip": True}
TOLD = {"response": "stopped"}


def test_counts_by_hazard_and_severity() -> None:
    table = result_rows.frame(
        {"group": "library/B24", **JUMPS},
        {"group": "library/B24", **JUMPS, **TOLD},
        {"group": "library/B24", "failed": "nan"},
        {"group": "B07,B08 not written", **TOLD},
        {"group": "fault_free"},
    )
    found = risk.counts(table)
    assert found.index.tolist() == ["B07", "B08", "B24"]
    assert found.to_numpy().tolist() == [[0, 0, 1, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 1, 1]]


def test_shares_of_reports_are_those_of_their_counts() -> None:
    reports = tomllib.loads((library.DATA / "maude.toml").read_text(encoding="utf-8"))
    for category in reports["category"]:  # the source gives per mille
        assert category["count"] / reports["reports"] == pytest.approx(category["share"], abs=1e-3)
    assert any(pool.hazards for pool in risk.report_pools())


def test_hazards_of_a_pool_count_alike_however_many_runs_they_have() -> None:
    table = result_rows.frame(*({"group": "g/B24", **JUMPS} for _ in range(9)), {"group": "g/C09"})
    row = risk.by_pool(risk.counts(table), Pool("H1-2", "", ("B24", "C09", "C10")))
    assert row.pool.hazards == ("B24", "C09")
    assert row.injury is not None and row.injury.value == pytest.approx(0.5)
    assert np.isnan(row.injury.low)  # two hazards are no sample of hazards
    assert row.mean == pytest.approx(2.5)


HALVES = [[1, 0, 0, 0, 0, 0]] * 5 + [[0, 0, 0, 0, 0, 1]] * 5
"""Runs of ten hazards by severity: harmless, or the gravest."""


def test_the_interval_of_a_pool_counts_hazards_not_runs() -> None:
    ids = tuple(f"C{number:02}" for number in range(1, 11))
    few = risk.mean_over(np.repeat([0.0, 1.0], 5), ids, np.ones(10))
    many = risk.by_pool(50 * pd.DataFrame(HALVES, ids), Pool("", "", ids)).injury
    assert many == pytest.approx(few) and few.low < 0.3 and few.high > 0.7
    twice = risk.mean_over(np.repeat([0.0, 1.0], 5), ("C01",) * 5 + ("C02",) * 5, np.ones(10))
    assert np.isnan(twice.low)  # one that counts in two classes is one unit


def test_pools_weigh_against_each_other_and_leave_out_what_was_not_run() -> None:
    pools = [
        Pool("a", "", ("M01",), 0.4),
        Pool("b", "", ("C08", "C12"), 0.1),
        Pool("c", "", ("M06",), 0.5),
    ]
    table = result_rows.frame({"group": "g/M01", **JUMPS}, {"group": "g/C08"}, {"group": "g/C12"})
    whole = risk.together(risk.counts(table), pools, "all", "")
    assert whole.pool.weight == pytest.approx(0.5)
    assert whole.injury is not None and whole.injury.value == pytest.approx(0.8)


def test_without_runs_there_is_no_risk() -> None:
    row = risk.by_pool(pd.DataFrame(), Pool("a", "", ("B24",)))
    assert row.injury is None and math.isnan(row.mean)
