"""Rates of false cues and alarms over a campaign's golden runs and the motion beside it, against
plain pandas.
"""

import numpy as np
import pytest
import synthetic_results as synthetic

from ravenjax.report.data.runs import Runs
from ravenjax.stats.alarms.false_alarms import alarm_rate
from ravenjax.store.access import fault_free
from ravenjax.store.folder import ResultFolder

CONFIG = {"campaign": {"name": "c"}, "operator": {"motion": "suture", "seed": 1, "scale": 0.1}}
MANIFEST = synthetic.manifest(400, config=CONFIG)
GOLDEN = 20


def golden(frame, first_ms, pedal_ms, number):
    """Rows whose golden runs, `number` different ones, have their first cues and time in
    pedal-down so.
    """
    which = np.arange(len(frame)) % number
    return frame.assign(
        operator="suture",
        golden_tip_path_mm=which + 0.5,
        golden_cue0_first_ms=np.asarray(first_ms)[which],
        golden_pedal_down_ms=np.asarray(pedal_ms)[which],
    )


FIRST = np.where(np.arange(GOLDEN) % 5 == 0, 600 + 10 * np.arange(GOLDEN), -1)
PEDAL = 2800 - np.arange(GOLDEN)
FRAME = golden(synthetic.frame(400), FIRST, PEDAL, GOLDEN)


def test_golden_runs_count_once_until_their_first_cue():
    free = Runs.of(FRAME, MANIFEST).motions
    assert (free.count, free.hands) == (GOLDEN, 1)
    assert free.hours == pytest.approx(PEDAL.sum() / 3.6e6)
    until = np.where(FIRST >= 0, PEDAL * FIRST / 3000, PEDAL)
    assert free.cue_rate(0) == pytest.approx(alarm_rate(4, until.sum() / 3.6e6))
    assert free.count_with_event("golden_cue0_first_ms") == 4
    assert free.cue_rate(1) == pytest.approx(alarm_rate(0, PEDAL.sum() / 3.6e6))


def beside(folder, first_ms, alarm_ms, length_ms=600_000):
    """A folder of fault-free motion: one run each, its first cue and the first alarm of detector
    0, threshold 0.
    """
    rows = len(first_ms)
    config = CONFIG | {"operator": CONFIG["operator"] | {"seed": 2}}
    frame = synthetic.frame(rows).assign(
        failed="",
        operator="suture",
        golden_pedal_down_ms=length_ms - 200,
        golden_cue0_first_ms=first_ms,
        golden_tip_path_mm=np.arange(rows) + 1000.0,
        detector0_threshold0_first_ms=alarm_ms,
        golden_detector0_score=np.where(np.asarray(alarm_ms) >= 0, 0.7, 0.4),
    )
    made = synthetic.manifest(rows, config=config, duration_ms=length_ms)
    ResultFolder.open(folder / fault_free.FOLDER / "suture_2", made).add(frame)


def test_motion_beside_the_result_counts_with_its_own_length(tmp_path):
    first, alarm = [120_000, -1, -1], [-1, 30_000, -1]
    beside(tmp_path, first, alarm)
    result = ResultFolder.open(tmp_path, MANIFEST)
    result.add(FRAME)
    runs = Runs.open(tmp_path, result.manifest)
    free = runs.motions
    assert (free.count, free.hands) == (GOLDEN + 3, 2)
    assert free.hours == pytest.approx((PEDAL.sum() + 3 * 599_800) / 3.6e6)
    own = np.where(FIRST >= 0, PEDAL * FIRST / 3000, PEDAL).sum()
    more = 599_800 * (120_000 / 600_000 + 2)
    assert free.cue_rate(0) == pytest.approx(alarm_rate(5, (own + more) / 3.6e6))
    # the table says of golden runs whether an alarm came, and of the motion beside also when
    rate = free.first_rate("golden_detector0_score > 0.5", "detector0_threshold0_first_ms")
    assert rate == pytest.approx(alarm_rate(1, (PEDAL.sum() + 599_800 * (2 + 0.05)) / 3.6e6))
    runs.close()
