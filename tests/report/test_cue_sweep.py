"""The cue sweep against plain counts."""

from __future__ import annotations

import numpy as np
import pytest
import synthetic_results as synthetic
from cue_results import FRAME, HAZARD, LOW, MANIFEST, ROWS, missed

from ravenjax.document.chart import Dots
from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import cues
from ravenjax.stats.alarms.choice import front
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.intervals import wilson


@pytest.mark.parametrize("k", range(len(synthetic.CUES)))
def test_a_set_against_a_plain_count(k):
    assert ROWS[k].missed == wilson(int(missed(FRAME, k).sum()), int(HAZARD.sum()))
    free = FRAME.groupby(["operator", "golden_tip_path_mm"], observed=True)[
        [f"golden_cue{k}_first_ms", "golden_pedal_down_ms"]
    ].first()
    first, pedal = (
        free[f"golden_cue{k}_first_ms"].to_numpy(),
        free["golden_pedal_down_ms"].to_numpy(),
    )
    assert ROWS[k].false == wilson(int((first >= 0).sum()), len(free))
    hours = np.where(first >= 0, pedal * first / MANIFEST.duration_ms, pedal).sum() / 3.6e6
    assert ROWS[k].per_hour == pytest.approx(alarm_rate(int((first >= 0).sum()), hours))
    cue = FRAME[f"cue{k}_first_ms"]
    before = HAZARD & ~missed(FRAME, k) & (cue < FRAME["unintended_first_ms"])
    assert (ROWS[k].before.k, ROWS[k].before.n) == (int(before.sum()), int(HAZARD.sum()))
    told = HAZARD & ~missed(FRAME, k)
    assert ROWS[k].force == pytest.approx(float(FRAME.loc[told, f"cue{k}_peak_force"].median()))


def test_a_cue_that_the_golden_run_has_is_missed():
    assert any((FRAME["cue2_first_ms"] >= 700) & HAZARD & (FRAME["golden_cue2_first_ms"] == 700))
    quiet = FRAME.assign(**{f"golden_cue{k}_first_ms": -1 for k in LOW})
    rows = {row.number: row for row in cues.rows(Runs.of(quiet, MANIFEST))}
    assert rows[2].missed.k < ROWS[2].missed.k


def test_best_sets_are_beaten_by_none():
    rows = list(ROWS.values())
    best = front([row.missed.value for row in rows], [row.per_hour.per_hour for row in rows])
    assert [row.best for row in rows] == best.tolist() and 0 < sum(best) < len(rows)


def test_sets_come_by_threshold():
    made = [row.cue.threshold_mm for row in cues.rows(Runs.of(FRAME, MANIFEST))]
    assert made == sorted(made)


def test_figure():
    rows = list(ROWS.values())
    chart = cues.tradeoff(rows)
    assert chart is not None
    marks = [mark for mark in chart.marks if isinstance(mark, Dots)]
    places = sorted((x, y) for mark in marks for x, y in zip(mark.x, mark.y, strict=True))
    assert places == sorted((row.per_hour.per_hour, row.missed.value) for row in rows)
    assert sorted(x for mark in marks for x in mark.x_high) == sorted(
        row.per_hour.high for row in rows
    )
    assert chart.x.low == chart.y.low == 0 and chart.x.high > max(x for x, _ in places)
    assert all((mark.y_low <= mark.y).all() and (mark.y <= mark.y_high).all() for mark in marks)
    assert chart.y.high >= max(mark.y_high.max() for mark in marks)
    calm = FRAME.assign(hazard="none", unintended_first_ms=-1)
    assert cues.tradeoff(cues.rows(Runs.of(calm, MANIFEST))) is None
