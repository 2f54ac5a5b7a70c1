"""How sharp the rates are, against the formula and plain counts."""

from __future__ import annotations

import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import precision
from ravenjax.stats.intervals import wilson

FRAME = synthetic.frame(900)
ROWS = precision.rows(Runs.of(FRAME, synthetic.manifest(900)))


def test_rates_are_of_distinct_faults():
    valid = (FRAME["failed"] == "") & (FRAME["fault0_site"] != "")
    evading = (
        valid & FRAME["response"].isin(["silent", "limited"]) & (FRAME["unintended_first_ms"] >= 0)
    )
    for row in ROWS[1:]:
        mine = FRAME["group"] == row.group
        assert (
            row.rate == wilson(int((evading & mine).sum()), int((valid & mine).sum()))
            and row.runs == mine.sum()
        )
    assert ROWS[0].group == "all faults" and ROWS[0].rate == wilson(
        int(evading.sum()), int(valid.sum())
    )
    widths = [row.half_width for row in ROWS[1:]]
    assert widths == sorted(widths, reverse=True)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row.group)
def test_the_runs_asked_for_are_enough_and_not_too_many(row):
    for more, half in ((row.within_3, 0.03), (row.within_1, 0.01)):
        n = row.rate.n + more.expected
        found = wilson(round(row.rate.value * n), n)
        assert (found.high - found.low) / 2 <= half * 1.02
        assert more.safe >= more.expected
        if more.expected == 0:
            assert row.half_width <= half * 1.001
