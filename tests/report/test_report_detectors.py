"""Detectors against plain counts of the same rows."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import detectors
from ravenjax.stats.intervals import wilson
from ravenjax.store.manifest import DetectorRecord

RUNS = 900
MANIFEST = synthetic.manifest(RUNS)
FRAME = synthetic.frame(RUNS).assign(
    golden_tip_path_mm=np.arange(RUNS) % 50 + 0.5
)  # 50 fault-free motions an operator
FRAME["golden_detector0_score"] = np.where(
    FRAME["golden_tip_path_mm"] < 3, 0.7, 0.4
)  # over the lowest threshold in 3 of 50
TABLE = Runs.of(FRAME, MANIFEST)
FOUND = TABLE.once(detectors.alarms)
ROWS = {row.name: row for row in detectors.rows(TABLE)}
VALID = (FRAME["failed"] == "") & (FRAME["fault0_site"] != "")
MOVED = VALID & (FRAME["unintended_first_ms"] >= 0)


def test_every_detector_the_checks_and_the_cue():
    assert list(ROWS) == ["dsn16", "tip", "built-in checks", "haptic cue, 3 mm"]
    assert [threshold.threshold for threshold in ROWS["dsn16"].thresholds] == [0.5, 1.0, 2.0]
    assert ROWS["built-in checks"].roc is None and len(ROWS["built-in checks"].thresholds) == 1


@pytest.mark.parametrize("k", range(3))
def test_rates_of_a_threshold(k):
    threshold, first = ROWS["dsn16"].thresholds[k], FRAME[f"detector0_threshold{k}_first_ms"]
    alarm = VALID & (first >= 0)
    assert threshold.caught == wilson(int((alarm & MOVED).sum()), int(MOVED.sum()))
    assert threshold.harmless == wilson(int((alarm & ~MOVED).sum()), int((VALID & ~MOVED).sum()))
    assert threshold.precision == wilson(int((alarm & MOVED).sum()), int(alarm.sum()))


def test_checks_that_tell_nobody_are_no_alarm():
    (threshold,) = ROWS["built-in checks"].thresholds
    told = VALID & FRAME["response"].isin(["stopped", "flagged"])
    assert (FRAME["response"] == "limited").sum() > 20
    assert threshold.caught == wilson(int((told & MOVED).sum()), int(MOVED.sum()))
    assert threshold.precision == wilson(int((told & MOVED).sum()), int(told.sum()))
    early = told & MOVED & (FRAME["told_ms"] < FRAME["unintended_first_ms"])
    assert threshold.before == wilson(int(early.sum()), int(MOVED.sum()))


def test_rates_are_of_faults_as_everywhere_on_the_page():
    (faults,) = TABLE.faults()
    for row in ROWS.values():
        for threshold in row.thresholds:
            assert (threshold.caught.n, threshold.caught.n + threshold.harmless.n) == (
                faults.unintended,
                faults.faults,
            )


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
    alarm, motion = (
        FRAME.loc[MOVED, "detector0_threshold0_first_ms"],
        FRAME.loc[MOVED, "unintended_first_ms"],
    )
    assert threshold.before == wilson(
        int(((alarm >= 0) & (alarm < motion)).sum()), int(MOVED.sum())
    )
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
    listening.once(detectors.alarms).append(noisy._replace(quiet=True))
    more, less = (runs.count(f"{detectors.known(runs)} >= 0") for runs in (listening, TABLE))
    assert more > less


def test_enumerated_faults_have_no_interval_and_no_band():
    config = {"group": [{"name": name, "design": "grid"} for name in FRAME["group"].unique()]}
    manifest = synthetic.manifest(RUNS, config=config)
    runs = Runs.of(FRAME, manifest)
    for row in detectors.rows(runs):
        for threshold in row.thresholds:
            assert (
                threshold.caught.k
                == ROWS[row.name].thresholds[row.thresholds.index(threshold)].caught.k
            )
            rates = (
                threshold.caught,
                threshold.harmless,
                threshold.precision,
                threshold.before,
                threshold.delay_ms,
            )
            assert np.isnan([end for one in rates for end in (one.low, one.high)]).all()
        if row.roc is not None and row.auc is not None:
            assert (
                np.isnan(row.auc.low)
                and np.isnan(row.roc.curve.low).all()
                and np.isfinite(row.auc.value)
            )
    chart = detectors.roc_chart(detectors.rows(runs))
    assert chart is not None and not any(len(getattr(mark, "low", ())) for mark in chart.marks)


def test_no_curve_without_a_motion_or_without_a_second_fault():
    nothing = synthetic.judged(FRAME.assign(unintended_first_ms=-1))
    runs = Runs.of(nothing, MANIFEST)
    rows = detectors.rows(runs)
    assert all(row.roc is None for row in rows)
    assert detectors.roc_chart(rows) is None and detectors.precision_recall_chart(rows) is None


def test_many_thresholds_are_thinned_and_the_quiet_one_stays():
    thresholds = tuple(np.linspace(0.1, 4, 40).tolist())
    columns = {
        f"detector0_threshold{k}_first_ms": np.where(FRAME["detector0_score"] > x, 900, -1)
        for k, x in enumerate(thresholds)
    }
    frame = pd.concat(
        [FRAME.drop(columns=[c for c in columns if c in FRAME]), pd.DataFrame(columns)], axis=1
    )
    manifest = synthetic.manifest(
        RUNS,
        detectors=(DetectorRecord("many", "steps", "all", 1, thresholds), MANIFEST.detectors[1]),
    )
    runs = Runs.of(frame, manifest)
    row = detectors.rows(runs)[0]
    assert detectors.MOST_THRESHOLDS <= len(row.thresholds) <= detectors.MOST_THRESHOLDS + 1
    assert [threshold.threshold for threshold in row.thresholds if threshold.quiet] == [
        min(x for x in thresholds if x >= 0.7)
    ]


def test_charts_hold_their_curves():
    curves = detectors.curves(TABLE)
    rows = list(ROWS.values())
    delays, leads = detectors.delay_chart(curves, 3000), detectors.lead_chart(curves)
    drawn = [(curve, one.delay, 100.0) for curve, one in zip(delays.marks, curves, strict=True)]
    findings = [one for one in curves if one.leads]
    ends = [float(one.lead.lag.time[-1]) for one in findings]
    drawn += [
        (curve, one.lead.lag, at)
        for curve, one, at in zip(leads.marks, findings, ends, strict=True)
    ]
    for curve, truth, at in drawn:
        place = np.searchsorted(truth.time, at, side="right") - 1
        assert curve.at(at)[0] == pytest.approx(truth.fraction[place], abs=0.005)
        assert len(curve.x) < 450
    assert [one.name for one in curves if not one.leads] == [
        "tip",
        "haptic cue, 3 mm",
    ]  # by definition at 3 mm
    roc, recall = detectors.roc_chart(rows), detectors.precision_recall_chart(rows)
    assert roc is not None and recall is not None
    for chart in (roc, recall):
        assert (chart.x.low, chart.x.high, chart.y.low, chart.y.high) == (0, 1, 0, 1)
        named = {name.partition(" (")[0] for name, *_ in chart.legend()}
        assert named == {row.name.partition(" (")[0] for row in rows}


def test_curves_beyond_the_largest_wait_in_the_legend():
    first = next(row for row in ROWS.values() if row.roc is not None)
    many = [first._replace(name=f"detector {k}") for k in range(detectors.DRAWN + 3)]
    chart = detectors.roc_chart(many)
    assert chart is not None and sum(visible for *_, visible in chart.legend()) == detectors.DRAWN
