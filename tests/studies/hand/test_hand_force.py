"""The study of the moved hand: pairs and effects of made-up runs, statics by hand, and its
reaction times.
"""

import pandas as pd
import pytest

from studies import hand
from studies.hand import GRIP_COLUMN, NEWTONS_COLUMN, SCALE

FAULTS = 24


def made_up(moved_golden: float = -0.1, moved_model: float = 0.0) -> pd.DataFrame:
    """Each fault of twelve kinds under no force and under one that moves every second hand by 2
    mm; rows mixed.
    """
    rows = []
    for fault in range(FAULTS):
        for newtons in (0.0, 3.3):
            yields = newtons > 0 and fault % 2 == 0
            rows.append(
                {
                    "pair": fault,
                    "group": f"sampled/{fault % 12}",
                    NEWTONS_COLUMN: newtons,
                    GRIP_COLUMN: 0.5,
                    "hand_mm": 2.0 if yields else 0.0,
                    "rms_model_deviation_mm": 5.0 + moved_model * yields,
                    "rms_golden_deviation_mm": 6.0 + moved_golden * yields,
                    "cue0_ms": 100.0,
                    "cue0_count": 1.0 + yields,
                    "tip_path_mm": 50.0 * (1.0 + 0.02 * yields),
                    "response": "stopped" if fault == 4 and yields else "silent",
                    "activated": fault != 1,
                    "failed": fault == 3,
                    "unintended": fault < 8 and not (yields and fault == 0),
                }
            )
    return pd.DataFrame(rows).sample(frac=1.0, random_state=1).reset_index(drop=True)


def test_an_effect_is_over_the_hands_that_moved() -> None:
    one = hand.effect(hand.paired(made_up(), 3.3, 0.5))
    assert (one.pairs, one.pulled, one.kinds.count) == (22, 12, 6)
    assert (
        one.hand.value == 2.0 and one.golden.value == pytest.approx(-0.1) and one.model.value == 0.0
    )
    assert (
        one.golden_share.value == pytest.approx(0.1 / (SCALE * 2.0))
        and one.model_share.value == 0.0
    )
    assert (
        one.pulses.value == 1.0
        and one.cue_ms.value == 0.0
        and one.path.value == pytest.approx(0.02)
    )
    assert one.unintended == (6, 5) and one.difference.value == pytest.approx(-1 / 22)


def test_statics_are_those_of_a_spring() -> None:
    rows = {(row[0], row[1]): row[2:] for row in hand.loop_rows()}
    relaxed = rows["the cap of 0.05 units is 3.3 N", 0.0]
    assert float(relaxed[0]) == pytest.approx(3.3 / 135.0 * 1e3, rel=0.02)
    assert float(relaxed[2]) == pytest.approx(0.1 * 4.5 * 66.0 / 135.0, rel=0.02)
    assert float(rows["one device unit is 3.3 N", 1.0][1]) == pytest.approx(
        0.1 * 0.165 / 675.0 * 1e3, rel=0.05
    )
