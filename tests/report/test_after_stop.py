"""What happens after a stop, against plain pandas."""

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import after_stop
from ravenjax.stats.intervals import wilson_interval

RUNS = 1500
LIMIT = 2.5  # mm
MANIFEST = synthetic.manifest(RUNS, limit_mm=LIMIT)
FRAME = synthetic.frame(RUNS)
FRAME = synthetic.judged(
    FRAME.assign(
        unintended_first_ms=np.where(
            FRAME["unintended_first_ms"] >= 0, FRAME["fault0_start_ms"] + 40, -1
        ),
        cue0_first_ms=np.where(
            np.arange(RUNS) % 5 == 0, FRAME["response_ms"], FRAME["cue0_first_ms"]
        ),
    )
)
STOPPED = FRAME[
    (FRAME["fault0_site"] != "") & (FRAME["failed"] == "") & (FRAME["response"] == "stopped")
]
ROWS = after_stop.stop_rows(Runs.of(FRAME, MANIFEST))


def quantiles(values):
    return pytest.approx([np.quantile(values, q) for q in (0.5, 0.95, 1.0)])


def test_every_stop_and_each_cause_by_pandas():
    causes = STOPPED["response_cause"].value_counts()
    assert ROWS[0].cause == "every stop" and ROWS[0].n == len(STOPPED)
    assert sorted(row.cause for row in ROWS[1:]) == sorted(causes.index)
    assert [row.n for row in ROWS[1:]] == causes.tolist()
    for row in ROWS:
        mine = (
            STOPPED
            if row.cause == "every stop"
            else STOPPED[STOPPED["response_cause"] == row.cause]
        )
        stop, cue, moved = (
            mine[name] for name in ("response_ms", "cue0_first_ms", "unintended_first_ms")
        )
        assert list(row.took_ms) == quantiles(stop - mine["first_active_ms"])
        assert list(row.off_mm) == quantiles(mine["unintended_off_mm"])
        before = (moved >= 0) & (moved <= stop)
        assert row.before == wilson_interval(int(before.sum()), len(mine))
        assert row.after == wilson_interval(
            int((~before & (mine["unintended_off_mm"] > LIMIT)).sum()), len(mine)
        )
        assert row.cue_before == wilson_interval(int(((cue >= 0) & (cue < stop)).sum()), len(mine))
        assert row.cue_after == wilson_interval(int((cue >= stop).sum()), len(mine))
        assert row.no_cue == wilson_interval(int((cue < 0).sum()), len(mine))
        assert row.restarted.k == (mine["restart_ms"] >= 0).sum()


def test_a_cue_in_the_millisecond_of_the_stop_came_too_late():
    frame = synthetic.judged(FRAME.assign(cue0_first_ms=FRAME["response_ms"]))
    first, *_ = after_stop.stop_rows(Runs.of(frame, MANIFEST))
    assert (first.cue_before.k, first.cue_after.k, first.no_cue.k) == (0, first.n, 0)
