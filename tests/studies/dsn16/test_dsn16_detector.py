"""Thresholds and alarms of the published detector on logs that are made up."""

import numpy as np

from studies.dsn16.detector import VARIABLES, run_alarms
from studies.dsn16.thresholds import pooled_interval

ONES = np.ones((3, 3))


def made_up(rows: int = 1200) -> dict[str, np.ndarray]:
    """A log in which nothing moves."""
    still = {name: np.zeros((rows, 7)) for name in VARIABLES}
    return {"last_seq": np.arange(1, rows + 1), "position": np.zeros((rows, 3)), **still}


def test_fused_alarm_needs_all_three_in_one_row() -> None:
    """Row i of the steps leads from packet i + 1 to packet i + 2; velocities must be over in two
    rows.
    """
    one = made_up()
    one["mpos"][1001:, 0] += 2.0  # a step in the row of packet 1001
    one["jpos"][1001:, 2] += 2.0
    one["mvel"][1001:, 1] += 2.0
    found = run_alarms(one, ONES, 1000, 4)
    assert found.tolist() == [True, False, True, False]  # velocity in one row only
    one["mvel"][1002:, 1] += 2.0
    found = run_alarms(one, ONES, 1000, 4)
    assert found.all()


def test_block_bootstrap_keeps_runs_together() -> None:
    """Steps that are alike within a run and differ between runs: only the draw of runs moves the
    percentile.
    """
    rng = np.random.default_rng(1)
    level = rng.uniform(1.0, 2.0, 50)
    together = np.repeat(level[:, None], 200, axis=1)
    apart = rng.permutation(together.ravel()).reshape(50, 200)
    wide, narrow = pooled_interval(together, 99.0), pooled_interval(apart, 99.0)
    assert wide.value == narrow.value
    assert wide.low <= wide.value <= wide.high
    assert wide.high - wide.low > 3.0 * (narrow.high - narrow.low)
    assert (wide.n, wide.of) == (50, "runs")
