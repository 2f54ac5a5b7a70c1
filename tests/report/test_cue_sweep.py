"""The cue sweep against plain counts, and what the data choose of the haptic sets, or need to
choose.
"""

import math

import numpy as np
import pytest
import synthetic_results as synthetic
from cue_results import FRAME, HAZARD, MANIFEST, ROWS, RUNS, TABLE, missed

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import cues
from ravenjax.stats.alarms.choice import unbeaten_choices
from ravenjax.stats.alarms.false_alarms import alarm_rate, hours_to_bound
from ravenjax.stats.intervals import wilson_interval


@pytest.mark.parametrize("k", range(len(synthetic.CUES)))
def test_a_set_against_a_plain_count(k):
    assert ROWS[k].missed == wilson_interval(int(missed(FRAME, k).sum()), int(HAZARD.sum()))
    free = FRAME.groupby(["operator", "golden_tip_path_mm"], observed=True)[
        [f"golden_cue{k}_first_ms", "golden_pedal_down_ms"]
    ].first()
    first, pedal = free.to_numpy().T
    assert ROWS[k].false == wilson_interval(int((first >= 0).sum()), len(free))
    hours = np.where(first >= 0, pedal * first / MANIFEST.duration_ms, pedal).sum() / 3.6e6
    assert ROWS[k].per_hour == pytest.approx(alarm_rate(int((first >= 0).sum()), hours))
    cue = FRAME[f"cue{k}_first_ms"]
    before = HAZARD & ~missed(FRAME, k) & (cue < FRAME["unintended_first_ms"])
    assert (ROWS[k].before.k, ROWS[k].before.n) == (int(before.sum()), int(HAZARD.sum()))
    told = HAZARD & ~missed(FRAME, k)
    assert ROWS[k].force == pytest.approx(float(FRAME.loc[told, f"cue{k}_peak_force"].median()))


def test_best_sets_are_beaten_by_none():
    rows = list(ROWS.values())
    best = unbeaten_choices(
        [row.missed.value for row in rows], [row.per_hour.per_hour for row in rows]
    )
    assert [row.best for row in rows] == best.tolist() and 0 < sum(best) < len(rows)


def test_a_minute_of_motion_chooses_nothing_and_says_what_it_needs():
    """80 golden runs of 2.8 s: no false cue at 2 mm and above says nothing about an hour."""
    found = {one.rule: one for one in cues.choose_cues(TABLE, list(ROWS.values()))}
    assert TABLE.motions.hours == pytest.approx(80 * 2.8 / 3600)
    strict = found["false cues an hour: at most 0.5"]
    assert strict.row is None and strict.possible == "2, 3 or 5 mm" and math.isnan(strict.least_mm)
    assert strict.hours == pytest.approx(hours_to_bound(0.5)) == pytest.approx(7.378, abs=1e-3)
    loose = found["false cues an hour: at most 60"]  # 3.689 / 60 h = 3.7 min are there
    assert loose.row is not None and loose.row.cue.threshold_mm == 2.0 and math.isnan(loose.hours)


def motion_for(hours):
    """The same faults with golden runs that are together so long, and a result whose runs are
    so, too.
    """
    pedal = int(hours * 3.6e6 / 80)
    manifest = synthetic.manifest(RUNS, duration_ms=pedal + 200)
    return FRAME.assign(golden_pedal_down_ms=pedal), manifest


def test_as_many_hours_as_it_asks_for_decide():
    chosen = {}
    for hours in (7.0, 7.4):
        frame, manifest = motion_for(hours)
        runs = Runs.of(frame, manifest)
        chosen[hours] = {one.rule: one for one in cues.choose_cues(runs, cues.cue_rows(runs))}
    assert chosen[7.0]["false cues an hour: at most 0.5"].row is None
    named = chosen[7.4]["false cues an hour: at most 0.5"]
    assert named.row is not None and named.row.cue.threshold_mm == 2.0
    # The other gain does exactly as well.
    assert named.row.per_hour.high <= 0.5 and named.alike == 1
