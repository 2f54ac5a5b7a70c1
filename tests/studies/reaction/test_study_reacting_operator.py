"""The study of the reacting operator: pairs, times and prices of made-up runs with known
answers, and the whole.
"""

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from ravenjax.report.sections.reaction import EXCURSION
from ravenjax.vocabulary.reactions import RELEASE
from studies import reacting_operator
from studies.runs import Runs

ACTION = "param:reaction.action"
FACTS: dict[str, Any] = {
    "failed": False,
    "faulty": True,
    "activated": True,
    "unintended": False,
    "unintended_ms": -1,
    "hazard": "none",
    "active_ms": 1000,
    "layer": "packets",
}


QUIET: dict[str, Any] = {
    "group": "sampled/a",
    "peak_live_deviation_mm": 1.0,
    "golden_peak_live_deviation_mm": 0.7,
    "unintended_mm": 0.5,
    "unintended_off_mm": 0.1,
    EXCURSION: 0.5,
    "jump_tip": False,
    "jump_text": False,
    "jump_tip_first_ms": -1,
    "tissue_depth_mm": 0.0,
    "golden_tissue_depth_mm": 0.0,
    "reaction_ms": -1,
    "response": "silent",
    "idle_ms": 0,
    "pedal_down_ms": 2500,
    "golden_pedal_down_ms": 2500,
    "cue0_first_ms": -1,
    "golden_cue0_first_ms": -1,
    "fault0_start_ms": 1000,
    "fault0_duration_ms": 10,
    "param:reaction.delay_ms": 200.0,
    ACTION: 0.0,
}


def runs(*rows: tuple[dict[str, Any], dict[str, Any]]) -> Runs:
    """Runs by hand: what differs from a quiet one in the table, and in its facts; each its own
    fault.
    """
    frame = pd.DataFrame(
        [
            {**QUIET, **FACTS, "pair": k, "distinct": k, **row, **fact}
            for k, (row, fact) in enumerate(rows)
        ]
    )
    made = SimpleNamespace(duration_ms=3000, limit_mm=10.0)
    return Runs(frame.assign(action=frame[ACTION].astype(int)), made)  # pyright: ignore


def paired_runs(*pairs: tuple[dict[str, Any], dict[str, Any]], action: int = RELEASE) -> Runs:
    """Each pair as (what nobody's run shows, what the reacting run shows)."""
    rows = []
    for k, (without, with_) in enumerate(pairs):
        rows.append(({**without, "pair": 2 * k}, {"distinct": k}))
        rows.append(({**with_, "pair": 2 * k, ACTION: float(action)}, {"distinct": k}))
    return runs(*rows)


ACTED = {"reaction_ms": 1300}
MOVED = {"unintended_mm": 12.0, EXCURSION: 12.0}


def test_a_contrast_counts_what_was_avoided_and_what_was_caused() -> None:
    table = paired_runs(
        *[(MOVED, ACTED)] * 6,  # avoided
        *[({}, {**ACTED, **MOVED})] * 2,  # made worse
        *[(MOVED, {**MOVED, **ACTED})] * 3,
        *[({}, {})] * 9,  # nothing was felt
    )
    found = reacting_operator.contrast_of(reacting_operator.paired(table, RELEASE), 10.0)
    assert (found.n, found.avoided.k, found.caused, found.acted) == (20, 6, 2, 11)
    assert (found.without, found.with_, found.kinds.count) == (9, 5, 1)
    assert found.avoided[:3] == pytest.approx((6, 9, 6 / 9))
    assert found.p == 1  # one kind: its labels exchanged give the same
    assert math.isnan(found.needed.low)  # and no other kind to compare with
    assert found.needed.value == pytest.approx(11 / 4)


BEGAN = {"unintended": True, "unintended_ms": 1400}


def test_leads_are_of_motion_and_of_the_faults_own_cue() -> None:
    table = runs(
        ({"cue0_first_ms": 1100}, BEGAN),
        ({"cue0_first_ms": 1500}, BEGAN),  # after the motion
        ({}, BEGAN),  # never
        ({"cue0_first_ms": 1100, "golden_cue0_first_ms": 1000}, BEGAN),  # the golden run's cue
        ({"cue0_first_ms": 1100}, {}),  # no motion
    )
    lead = reacting_operator.leads_ms(table, 0)
    np.testing.assert_array_equal(lead, [300, -100, -np.inf, -np.inf, np.nan])
    found = reacting_operator.advance(table, 0, 3.0)
    assert (found.size_mm, found.n, found.before.k, found.half_ms.value) == (10.0, 4, 1, -100)
    # 150, 250, 400 ms: 300 ms are enough for two
    assert [rate.k for rate in found.late.values()] == [3, 3, 4]


@pytest.mark.slow
def test_the_study_runs(reproduced) -> None:
    found = reproduced(reacting_operator.STUDY, ("campaign.limit=1000",))
    value = {line.quantity: line.predicted.value for line in found.lines if line.predicted}
    late = [
        value[
            f"unintended motion of {size:g} mm too soon for a reaction of 250 ms to a cue of 1 mm"
        ]
        for size in reacting_operator.SIZES_MM
    ]
    assert late == sorted(late, reverse=True)
    assert late[0] > 85.0
    assert value["unintended motions over 20 mm (live or not) that a lifted pedal avoids"] > 10
    assert not any(
        "of 3 mm too soon" in name and "cue of 3 mm" in name for name in value
    )  # such a cue is no early warning
    assert all(line.published is None for line in found.lines)
