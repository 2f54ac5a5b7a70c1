"""The study of the haptic cue: choices, rates and tables on made-up runs with known answers, and
the whole.
"""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from ravenjax.outcomes.events import Rules
from ravenjax.stats import units
from ravenjax.store.manifest import CueRecord
from studies import haptic_cue
from studies.haptic_cue import HAZARDS
from studies.runs import Runs

CUES = tuple(
    CueRecord(threshold_mm=mm, kp_per_mm=kp, kd_s_per_mm=9e-5, cap=0.05)
    for mm in (1.0, 3.0, 8.0)
    for kp in (0.0045, 0.009)
)
PUBLISHED, RULES = 2, Rules()
FIRST = [[110, 150, -1], [120, 250, -1], [-1, -1, -1], [130, -1, -1]]


def faulty(first: list[list[int]], unintended_ms: list[int], rules: Rules = RULES) -> Runs:
    """Runs felt at `first` [runs][thresholds], with either gain; effects begin at 100 ms."""
    n, began = len(first), np.array(unintended_ms)
    told = np.repeat(np.array(first), 2, axis=1)
    force = np.where(told >= 0, np.array([0.02, 0.04, 0.03, 0.05, 0.05, 0.05]), 0.0)
    columns = {
        "cell": np.arange(n),
        "group": [f"sampled/{k}" for k in range(n)],
        "motion": 0,
        "active_ms": 100,
        "unintended_ms": began,
        "unintended": began >= 0,
    }
    for k in range(len(CUES)):
        columns |= {f"cue{k}_first_ms": told[:, k], f"golden_cue{k}_first_ms": -1}
        columns |= {f"cue{k}_peak_force": force[:, k], f"cue{k}_ms": 500 * (told[:, k] >= 0)}
    made = SimpleNamespace(cues=CUES, verdict_cue=PUBLISHED, rules=rules, duration_ms=1000)
    return Runs(pd.DataFrame(columns), made)  # pyright: ignore[reportArgumentType]


def test_the_choice_weighs_missed_hazards_against_false_cues() -> None:
    # thresholds 1, 3, 8 mm miss 0, 1/4 and 3/4 of 4 hazards, with 20, 1 and 0 false cues an hour
    missed = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 1, 1]], bool)
    faults, weights = units.group_units(np.arange(4)), (1.0, 10.0, 1000.0)
    hours, recording = np.array([1.0]), np.array(["a"])
    false = np.array([[20, 1, 0]])
    found = haptic_cue.choose(missed, faults, false, hours, recording, weights)
    costs = [[20.0, 1.25, 0.75], [20.0, 3.5, 7.5], [20.0, 251.0, 750.0]]
    assert [one.cost.tolist() for one in found] == costs
    assert [one.winner for one in found] == [2, 1, 0]
    assert [one.wins.sum() for one in found] == pytest.approx([1.0] * 3)


def test_what_is_felt_is_measured_from_the_first_effect() -> None:
    runs = faulty(FIRST, [200, 200, 200, -1])
    found = haptic_cue.felt(runs, PUBLISHED)
    assert (found["missed"].value, found["missed"].n) == (pytest.approx(1 / 3), 3)
    assert found["others"].value == 0.0
    assert found["delay_ms"].value == 150  # of 50, 150 and never
    early = haptic_cue.felt(runs, 0)
    assert early["before"].value == pytest.approx(2 / 3) and early["lead_ms"].value == 80
    assert found["before"].value == pytest.approx(1 / 3) and found["lead_ms"].value == -50
    assert found["force"] == "0.03 (0.03 to 0.03)"
    assert found["at_cap"].value == 0.0
    assert haptic_cue.felt(runs, PUBLISHED + 1)["at_cap"].value == 1.0
    late = haptic_cue.missed(runs, [PUBLISHED], haptic_cue.LATE)[:, 0]
    assert late.tolist() == [False, True, True, True]


@pytest.mark.slow
def test_the_study_runs(reproduced, tmp_path: Path) -> None:
    faulty = dict.fromkeys(("suture", "reach", "every_cycle"), ("campaign.limit=800",))
    free = dict.fromkeys(("free_suture_11", "free_peg_transfer_11"), ("campaign.duration_s=10",))
    found = reproduced(haptic_cue.STUDY, faulty | free)
    shown = next(table for table in found.tables if table.title.startswith("Thresholds"))
    assert len(shown.rows) >= 12
    by_kind = next(table for table in found.tables if table.title.startswith("What the chosen"))
    assert {row[0] for row in by_kind.rows} == set(HAZARDS)
    lines = {line.quantity: line.predicted for line in found.lines}
    published = lines["cue of 3 mm (published): unintended motions without a cue"]
    assert published and 0 <= published.low <= published.value <= published.high < 50
    assert (tmp_path / "haptic_cue" / "findings.md").is_file()
