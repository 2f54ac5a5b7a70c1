"""The first page's numbers against plain counts."""

from pathlib import Path

import naive_facts
import numpy as np
import pytest
import synthetic_results as synthetic
from statsmodels.duration.survfunc import SurvfuncRight

from ravenjax.report.data.runs import Runs
from ravenjax.report.sections import answers, detectors
from ravenjax.stats.intervals import wilson_interval

MANIFEST = synthetic.manifest(1200)
FRAME = synthetic.frame(1200)
RUNS = Runs.of(FRAME, MANIFEST)
KNOWN = RUNS.table.frame(f"SELECT {detectors.knowledge_sql(RUNS)} AS ms FROM facts ORDER BY row")[
    "ms"
].to_numpy()
FAULTY = (FRAME["fault0_site"] != "").to_numpy()
VALID = FAULTY & (FRAME["failed"] == "").to_numpy()
UNKNOWN = VALID & FRAME["response"].isin(["silent", "limited"]).to_numpy()
MOTION_MS = FRAME["unintended_first_ms"].to_numpy()
MOVED = VALID & (MOTION_MS >= 0)
LOST = VALID & ~MOVED & naive_facts.hazard(FRAME).eq("loss of motion").to_numpy()
EVADING = MOVED & UNKNOWN


def naive_known(index):
    """First of a check that tells, the cue and quiet detector thresholds that is not before the
    first effect.
    """
    row = FRAME.loc[index]
    quiet = [
        (0, 0),
        (1, 0),
    ]  # golden runs score 0.4: below the first threshold of both detectors, 0.5 and 3
    times = [
        row["told_ms"],
        row["cue0_first_ms"],
        *(row[f"detector{d}_threshold{k}_first_ms"] for d, k in quiet),
    ]
    return min([t for t in times if t >= max(0, row["first_active_ms"])], default=-1)


def test_first_possible_knowledge():
    chosen = FRAME.index[MOVED][:200]
    assert [KNOWN[index] for index in chosen] == [naive_known(index) for index in chosen]


def test_time_to_know_is_of_unintended_motions_and_censored():
    found = answers.detection_answers(RUNS)
    known, motion = KNOWN[MOVED], MOTION_MS[MOVED]
    assert (found.delay.n, found.delay.events) == (MOVED.sum(), (known >= 0).sum())
    assert found.before == wilson_interval(int(((known >= 0) & (known < motion)).sum()), len(known))
    times = (
        np.where(known >= 0, known, MANIFEST.duration_ms)
        - FRAME.loc[MOVED, "first_active_ms"].to_numpy()
    )
    curve = SurvfuncRight(times, known >= 0)
    assert found.half_ms.value == curve.quantile(0.5)
    assert found.half_ms.low <= found.half_ms.value and not found.half_ms.high < found.half_ms.value


@pytest.mark.parametrize(("kind", "column"), [("group", "group"), ("site", "fault0_site")])
def test_classes_against_a_plain_count(kind, column):
    rows = {row.name: row for row in answers.class_rows(RUNS, kind)}
    assert set(rows) == set(FRAME.loc[FAULTY, column].astype(str))
    for name, row in rows.items():
        mine = VALID & (FRAME[column].astype(str) == name).to_numpy()
        n = int(mine.sum())
        assert row.evaded == wilson_interval(int((EVADING & mine).sum()), n)
        assert row.unintended == wilson_interval(int((MOVED & mine).sum()), n)
        assert row.loss == wilson_interval(int((LOST & mine).sum()), n)
        before = MOVED & mine & (KNOWN >= 0) & (KNOWN < MOTION_MS)
        assert (row.before.k, row.before.n) == (int(before.sum()), int((MOVED & mine).sum()))
        far, off = (FRAME.loc[mine, f"unintended_{name}"] for name in ("mm", "off_mm"))
        quantiles = [np.quantile(far, q) for q in (0.5, 0.95, 1.0)]
        assert list(row.mm) == pytest.approx(quantiles, rel=1e-5)
        only_off = (off > MANIFEST.limit_mm) & ~MOVED[mine]
        assert row.not_live == only_off.sum()


def test_a_group_that_changes_the_robot_is_named_with_what_its_golden_runs_do():
    group = {"name": FRAME["group"].iloc[0], "parameters": {"control.kp": 2.0}}
    config = {**MANIFEST.config, "group": [group, {"name": "without runs", "parameters": {"x": 1}}]}
    frame = FRAME.assign(golden_halted_ms=np.where(FRAME["group"] == group["name"], 1400, 4))
    runs = Runs.of(frame, synthetic.manifest(1200, config=config))
    content = answers.FIRST_PAGE.content(runs, Path("out"))
    assert content["changed_groups"] == {group["name"]: ["control.kp"]}
    assert content["golden_halts"] == [(group["name"], 1400)]
