"""The study of detectors: choices, rates, areas and tables on made-up runs with known answers,
and the whole.
"""

import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from ravenjax.outcomes.events import Rules
from ravenjax.store.manifest import DetectorRecord
from studies import detectors
from studies import findings as findings_files
from studies.detectors import PUBLISHED
from studies.runs import Runs

DETECTORS = (
    DetectorRecord("steps/all/1", "steps", "all", 1, (0.5, 1.0, 2.0, 4.0)),
    DetectorRecord("steps/any/1", "steps", "any", 1, (0.5, 1.0, 2.0, 4.0)),
    DetectorRecord("derivative_sum", "derivative_sum", "all", 1, (10.0, 55.0)),
    DetectorRecord("tip_error", "tip_error", "all", 1, (1.0, 3.0)),
    DetectorRecord("overdrive", "overdrive", "all", 1, (0.5, 1.0)),
)


MADE = SimpleNamespace(detectors=DETECTORS, rules=Rules(), duration_ms=1000)


def faulty(first: list[list[int]], unintended_ms: list[int]) -> Runs:
    """Runs with an alarm of each detector at `first` [runs][detectors], at every threshold;
    effects begin at 100 ms.
    """
    times, began = np.array(first), np.array(unintended_ms)
    columns = {
        "group": [f"sampled/{k}" for k in range(len(first))],
        "active_ms": 100,
        "unintended_ms": began,
        "unintended": began >= 0,
    }
    for d, one in enumerate(DETECTORS):
        for k in range(len(one.thresholds)):
            columns[f"detector{d}_threshold{k}_first_ms"] = times[:, d]
    return Runs(pd.DataFrame(columns), MADE)  # pyright: ignore[reportArgumentType]


def free(alarms: list[list[int]], hours: float = 1.0) -> Runs:
    """One recording a row; `alarms` of steps/all/1 by threshold, nothing from the others."""
    columns = {"recording": [f"reach {k}" for k in range(len(alarms))], "hours": hours}
    for d, one in enumerate(DETECTORS):
        for k in range(len(one.thresholds)):
            columns[f"detector{d}_threshold{k}_alarms"] = [row[k] if not d else 0 for row in alarms]
    return Runs(pd.DataFrame(columns), MADE)  # pyright: ignore[reportArgumentType]


def test_a_threshold_is_the_lowest_from_which_on_alarms_are_rare_enough() -> None:
    # 2 h: 20, 0, 3 and 2 alarms at thresholds 0.5, 1, 2, 4: threshold 1 is quiet by chance,
    # threshold 2 is not
    motion = free([[20, 0, 3, 2], [0, 0, 0, 0]])
    assert detectors.threshold_for(motion, "steps/all/1") == 4.0
    assert detectors.threshold_for(motion, "steps/all/1", per_hour=1.5) == 1.0
    assert detectors.threshold_for(motion, "steps/all/1", per_hour=0.9) is None
    assert detectors.threshold_for(motion, "tip_error") == 1.0
    with pytest.raises(ValueError, match="no motion without a fault"):
        detectors.threshold_for(motion.where(np.zeros(2, bool)), "tip_error")


def test_a_point_counts_what_is_caught_before_the_motion_and_for_nothing() -> None:
    runs = faulty(
        [
            [150, 110, -1, -1, -1],
            [300, 110, -1, -1, -1],
            [-1, 110, -1, -1, -1],
            [120, 110, -1, -1, -1],
        ],
        unintended_ms=[200, 200, 200, -1],
    )
    found = detectors.point(runs, free([[0, 0, 0, 0]] * 2), *PUBLISHED)
    assert (found.caught.value, found.caught.n) == (pytest.approx(2 / 3), 3)
    assert found.before.value == pytest.approx(1 / 3)
    assert (found.false.value, found.false.n) == (0.0, 0)
    assert found.false.high == pytest.approx(3.689 / 2, rel=1e-3)


def test_areas_are_those_of_scikit_learn_and_variances_those_of_delong() -> None:
    from sklearn.metrics import roc_auc_score

    rng = np.random.default_rng(3)
    positive = rng.random(60) < 0.4
    score = np.round(
        rng.normal(size=(60, 2)) + positive[:, None] * np.array([1.0, 0.5]), 1
    )  # with ties
    value, covariance = detectors.areas(score, positive, np.arange(60))
    assert value == pytest.approx([roc_auc_score(positive, score[:, d]) for d in range(2)])
    # DeLong 1988, in loops
    x, y = score[positive], score[~positive]
    beats = (x[:, None] > y[None]) + 0.5 * (x[:, None] == y[None])  # [m, n, 2]
    delong = np.cov(beats.mean(axis=1).T) / len(x) + np.cov(beats.mean(axis=0).T) / len(y)
    assert covariance == pytest.approx(delong)


@pytest.mark.slow
def test_the_study_runs(tmp_path: Path) -> None:
    free = ("free_suture_11", "free_reach_11", "free_clutched_11", "noise_suture_11")
    variants = [
        one
        for one in detectors.STUDY.variants
        if one.name in ("suture", "reach", "suture_fast", "every_cycle")
    ]
    variants += [
        dataclasses.replace(one, overrides=(*one.overrides, "campaign.duration_s=20"))
        for one in detectors.STUDY.variants
        if one.name in free
    ]
    study = dataclasses.replace(detectors.STUDY, variants=tuple(variants))
    found = findings_files.reproduce(study, tmp_path)
    lines = {line.quantity: line.predicted for line in found.lines}
    areas = [one for name, one in lines.items() if name.startswith("AUC, ")]
    assert len(areas) > 3 and all(
        one and 0.4 < one.low < one.value <= one.high <= 1.0 for one in areas
    )
    assert "AUC, tip_error" not in lines  # friction parts robot and model without a fault
