"""The cue sweep against plain counts."""

import numpy as np
import pytest
import synthetic_results as synthetic
from cue_results import FRAME, HAZARD, MANIFEST, ROWS, missed

from ravenjax.stats.alarms.choice import unbeaten_choices
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.stats.intervals import wilson_interval


@pytest.mark.parametrize("k", range(len(synthetic.CUES)))
def test_a_set_against_a_plain_count(k):
    assert ROWS[k].missed == wilson_interval(int(missed(FRAME, k).sum()), int(HAZARD.sum()))
    free = FRAME.groupby(["operator", "golden_tip_path_mm"], observed=True)[
        [f"golden_cue{k}_first_ms", "golden_pedal_down_ms"]
    ].first()
    first, pedal = (
        free[f"golden_cue{k}_first_ms"].to_numpy(),
        free["golden_pedal_down_ms"].to_numpy(),
    )
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
