"""Detectors against plain counts of the same rows."""

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import detectors
from ravenjax.stats.intervals import wilson_interval

RUNS = 900
MANIFEST = synthetic.manifest(RUNS)
# 50 fault-free motions an operator
FRAME = synthetic.frame(RUNS).assign(golden_tip_path_mm=np.arange(RUNS) % 50 + 0.5)
# over the lowest threshold in 3 of 50
FRAME["golden_detector0_score"] = np.where(FRAME["golden_tip_path_mm"] < 3, 0.7, 0.4)
TABLE = Runs.of(FRAME, MANIFEST)
FOUND = TABLE.once(detectors.list_alarms)
ROWS = {row.name: row for row in detectors.detector_rows(TABLE)}
VALID = (FRAME["failed"] == "") & (FRAME["fault0_site"] != "")
MOVED = VALID & (FRAME["unintended_first_ms"] >= 0)


@pytest.mark.parametrize("k", range(3))
def test_rates_of_a_threshold(k):
    threshold, first = ROWS["dsn16"].thresholds[k], FRAME[f"detector0_threshold{k}_first_ms"]
    alarm = VALID & (first >= 0)
    assert threshold.caught == wilson_interval(int((alarm & MOVED).sum()), int(MOVED.sum()))
    assert threshold.harmless == wilson_interval(
        int((alarm & ~MOVED).sum()), int((VALID & ~MOVED).sum())
    )
    assert threshold.precision == wilson_interval(int((alarm & MOVED).sum()), int(alarm.sum()))


def test_false_alarms_count_each_motion_once():
    free = FRAME.groupby(["operator", "golden_tip_path_mm"], observed=True)[
        ["golden_detector0_score", "golden_pedal_down_ms"]
    ].first()
    for threshold in ROWS["dsn16"].thresholds:
        expected = int((free["golden_detector0_score"] > threshold.threshold).sum())
        assert threshold.false is not None and threshold.false.count == expected
        assert threshold.false.hours == pytest.approx(free["golden_pedal_down_ms"].sum() / 3.6e6)
        assert threshold.false.low <= threshold.false.per_hour <= threshold.false.high
    assert [threshold.quiet for threshold in ROWS["dsn16"].thresholds] == [False, True, False]
    assert ROWS["built-in checks"].thresholds[0].false is None


def test_delay_and_lead_of_a_threshold():
    threshold = ROWS["dsn16"].thresholds[0]
    moved = FRAME.loc[MOVED]
    alarm, motion = moved["detector0_threshold0_first_ms"], moved["unintended_first_ms"]
    before = (alarm >= 0) & (alarm < motion)
    assert threshold.before == wilson_interval(int(before.sum()), len(moved))
    delay = np.where(alarm >= 0, alarm - FRAME.loc[MOVED, "first_active_ms"], np.inf)
    assert threshold.delay_ms.value == np.sort(delay)[int(np.ceil(len(delay) / 2)) - 1] == 30


def test_area_is_the_chance_to_rank_a_motion_higher():
    score = FRAME["detector0_score"].to_numpy()
    high, low = score[MOVED], score[(VALID & ~MOVED).to_numpy()]
    pairs = high[:, None] - low[None, :]
    area = ROWS["dsn16"].auc
    assert area is not None and area.value == pytest.approx(
        ((pairs > 0) + 0.5 * (pairs == 0)).mean()
    )
    assert area.low < area.value < area.high < 1


def test_knowledge_comes_from_quiet_thresholds_alone():
    noisy = next(one for one in FOUND if one.name == "dsn16" and one.threshold == 0.5)
    listening = Runs.of(FRAME, MANIFEST)
    listening.once(detectors.list_alarms).append(noisy._replace(quiet=True))
    more, less = (
        runs.count(f"{detectors.knowledge_sql(runs)} >= 0") for runs in (listening, TABLE)
    )
    assert more > less


def test_no_curve_without_a_motion_or_without_a_second_fault():
    nothing = synthetic.judged(FRAME.assign(unintended_first_ms=-1))
    runs = Runs.of(nothing, MANIFEST)
    rows = detectors.detector_rows(runs)
    assert all(row.roc is None for row in rows)
    assert not any(detectors.curve_chart(rows, kind) for kind in ("roc", "recall"))
