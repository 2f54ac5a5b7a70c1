"""The study of the haptic cue: choices, rates and tables on made-up runs with known answers, and
the whole.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import synthetic_results

from ravenjax.outcomes.events import Rules
from ravenjax.stats.bootstrap import units
from ravenjax.store.manifest import CueRecord
from studies import findings as findings_files
from studies import haptic_cue
from studies.haptic_cue import KINDS, FaultyCues

CUES = tuple(
    CueRecord(threshold_mm=mm, kp_per_mm=kp, kd_s_per_mm=9e-5, cap=0.05)
    for mm in (1.0, 3.0, 8.0)
    for kp in (0.0045, 0.009)
)
PUBLISHED = 2


def faulty(first: list[list[int]], unintended_ms: list[int]) -> FaultyCues:
    """Runs felt at `first` [runs][thresholds], with either gain; effects begin at 100 ms."""
    n, began = len(first), np.array(unintended_ms)
    told = np.repeat(np.array(first), 2, axis=1)
    return FaultyCues(
        CUES,
        PUBLISHED,
        np.arange(n),
        np.arange(n),
        np.zeros(n, int),
        np.zeros(n, int),
        np.full(n, 100),
        began,
        np.repeat((began >= 0)[:, None], len(KINDS), axis=1),
        told,
        np.where(told >= 0, np.array([0.02, 0.04, 0.03, 0.05, 0.05, 0.05]), 0.0),
        np.where(told >= 0, 500, 0),
        1000,
        Rules(),
    )


def test_the_choice_weighs_missed_hazards_against_false_cues() -> None:
    # thresholds 1, 3, 8 mm miss 0, 1/4 and 3/4 of 4 hazards, with 20, 1 and 0 false cues an hour
    missed = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 1], [0, 1, 1]], bool)
    counts = haptic_cue.counts(
        missed, units.units(np.arange(4)), np.array([[20, 1, 0]]), np.array([1.0]), np.array(["a"])
    )
    found = haptic_cue.choose(counts, np.array([1.0, 10.0, 1000.0]))
    assert found.cost.tolist() == [[20.0, 1.25, 0.75], [20.0, 3.5, 7.5], [20.0, 251.0, 750.0]]
    assert found.winner.tolist() == [2, 1, 0]
    assert found.wins.sum(axis=1) == pytest.approx(1.0)


def test_a_rate_of_which_nothing_was_seen_decides_only_after_enough_hours() -> None:
    # set 0 misses 5 % less; it may cost so many false cues more as no cue in the hours leaves open
    missed = np.stack([np.arange(400) < 40, np.arange(400) < 60], axis=1)

    def found(hours: float) -> haptic_cue.Winners:
        counts = haptic_cue.counts(
            missed,
            units.units(np.arange(400)),
            np.zeros((9, 2)),
            np.full(9, hours / 9),
            np.arange(9),
        )
        return haptic_cue.choose(counts, np.array([10.0]))

    few, many = found(0.01), found(1000.0)
    assert few.winner.tolist() == many.winner.tolist() == [0]
    assert not few.sure[0] and few.wins[0] == pytest.approx([0.5, 0.5], abs=0.05)
    assert many.sure[0] and many.wins[0, 0] == 1.0


def test_what_is_felt_is_measured_from_the_first_effect() -> None:
    runs = faulty(
        [[110, 150, -1], [120, 250, -1], [-1, -1, -1], [130, -1, -1]],
        unintended_ms=[200, 200, 200, -1],
    )
    found = haptic_cue.felt(runs, PUBLISHED)
    assert (found.missed.value, found.missed.n) == (pytest.approx(1 / 3), 3)
    assert found.others.value == 0.0
    assert found.delay_ms.value == 150  # of 50, 150 and never
    assert (
        found.before.of == found.lead_ms.of == "by definition"
    )  # 3 mm of the tip, and a cue at 3 mm
    early = haptic_cue.felt(runs, 0)
    assert early.before.value == pytest.approx(2 / 3) and early.lead_ms.value == 80
    apart = haptic_cue.felt(runs._replace(rules=Rules(limit_mm=4.0)), PUBLISHED)
    assert apart.before.value == pytest.approx(1 / 3) and apart.lead_ms.value == -50
    assert found.force == "0.03 (0.03 to 0.03)"
    assert found.at_cap.value == 0.0
    assert haptic_cue.felt(runs, PUBLISHED + 1).at_cap.value == 1.0
    late = haptic_cue.missed(runs, [PUBLISHED], before=True)[:, 0]
    assert late.tolist() == [False, True, True, True]


def test_kinds_of_motion_are_those_of_the_result_table() -> None:
    made, frame = synthetic_results.manifest(runs=400), synthetic_results.frame(400)
    found = haptic_cue.pooled([frame], made)
    chosen = frame[frame["activated"] & (frame["fault0_site"] != "") & (frame["failed"] == "")]
    assert len(found.cell) == len(chosen) > 300
    assert found.unintended.tolist() == (chosen["unintended_mm"] > 3.0).tolist()
    assert found.unintended_ms.tolist() == chosen["unintended_first_ms"].tolist()
    apart = chosen[["unintended_mm", "unintended_off_mm"]].max(axis=1) > 3.0
    deeper = chosen["tissue_depth_mm"] - chosen["golden_tissue_depth_mm"] > 1.0
    injury = apart | deeper | chosen["jump_tip"] | chosen["jump_text"]
    assert found.kinds[:, KINDS.index(haptic_cue.INJURY)].tolist() == injury.tolist()
    assert injury.sum() > found.unintended.sum() > 20


def test_a_cue_of_the_golden_run_does_not_count() -> None:
    made = synthetic_results.manifest(runs=300)
    frame = synthetic_results.frame(300)
    plainly = haptic_cue.pooled([frame], made)
    shared = haptic_cue.pooled([frame.assign(golden_cue0_first_ms=0)], made)
    assert (plainly.first_ms[:, 0] >= 0).sum() > 20
    assert (shared.first_ms[:, 0] >= 0).sum() == 0
    assert (shared.first_ms[:, 1:] == plainly.first_ms[:, 1:]).all()


@pytest.mark.slow
def test_the_study_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(haptic_cue, "MOTIONS", ("suture", "reach"))
    monkeypatch.setattr(
        haptic_cue, "RECORDINGS", tuple((motion, 11) for motion in ("suture", "peg_transfer"))
    )
    monkeypatch.setattr(haptic_cue, "FREE_S", 20)
    found = findings_files.reproduce(
        dataclasses.replace(haptic_cue.STUDY, variants=haptic_cue._variants()), tmp_path
    )
    shown = next(table for table in found.tables if table.title.startswith("Thresholds"))
    assert len(shown.rows) >= 12
    by_kind = next(table for table in found.tables if table.title.startswith("What the choice"))
    assert {row[0] for row in by_kind.rows} == set(KINDS)
    lines = {line.quantity: line.predicted for line in found.lines}
    published = lines["3 mm (published): unintended motion missed"]
    assert published and 0 <= published.low <= published.value <= published.high < 50
    assert (tmp_path / "haptic_cue" / "findings.md").is_file()
