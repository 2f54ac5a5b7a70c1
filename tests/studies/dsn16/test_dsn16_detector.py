"""Thresholds and alarms of the published detector on logs that are made up."""

from __future__ import annotations

import numpy as np

from studies.dsn16 import detector
from studies.dsn16.detector import Learned, Log, log, pooled_interval, run_alarms

ONES = np.ones((3, 3))


def made_up(rows: int = 1200) -> Log:
    """A log in which nothing moves."""
    return Log(
        np.arange(1, rows + 1), *(np.zeros((rows, 3)) for _ in range(4)), np.zeros((rows, 7))
    )


def test_log_has_a_row_a_packet_and_ends_with_the_packets() -> None:
    ticks = 10
    number = np.array([0, 1, 1, 2, 2, 3, 3, 3, 3, 3])
    wide = np.arange(ticks, dtype=float)[:, None] * np.ones(7)
    series = {"last_seq": number, "gold/position": wide[:, :3] * 1e-6}
    found = log(series | {f"gold/{name}": wide for name in ("mpos", "mvel", "jpos")})
    assert found.packet.tolist() == [1, 2, 3]
    assert (
        found.mpos[:, 0].tolist()
        == found.tip[:, 1].tolist()
        == found.joints[:, 6].tolist()
        == [1.0, 3.0, 5.0]
    )


def test_fused_alarm_needs_all_three_in_one_row() -> None:
    """Row i of the steps leads from packet i + 1 to packet i + 2; velocities must be over in two
    rows.
    """
    one = made_up()
    one.mpos[1001:, 0] += 2.0  # a step in the row of packet 1001
    one.jpos[1001:, 2] += 2.0
    one.mvel[1001:, 1] += 2.0
    found = run_alarms(one, ONES, 1000, 4)
    assert found.inside == (True, False, True, False)  # velocity in one row only
    one.mvel[1002:, 1] += 2.0
    found = run_alarms(one, ONES, 1000, 4)
    assert found.inside == (True, True, True, True)
    assert found.first == 1  # packet 1001, one after t1


def test_alarms_outside_the_window_count_anywhere_alone() -> None:
    late = made_up()
    for column in (late.mpos, late.jpos, late.mvel):
        column[1100:, 0] += 2.0
    late.mvel[1101:, 0] += 2.0
    found = run_alarms(late, ONES, 1000, 4)
    assert not any(found.inside) and all(found.anywhere) and found.first == -1
    assert all(run_alarms(late, ONES, 1000, 99).inside)  # packet 1100 is in 1000 .. 1000 + 99 + 1
    assert not any(run_alarms(late, ONES, 1000, 98).inside)


def test_learned_thresholds_are_percentiles_of_all_steps_or_of_maxima() -> None:
    steps = np.zeros((10, 100, 3, 3))
    steps[:, 0, 0, 0] = np.arange(10)  # one large step a run
    learned = Learned(steps)
    assert learned.percentile(90.0)[0, 0] == 0.0
    assert learned.percentile(100.0)[0, 0] == 9.0
    assert learned.percentile_of_maxima(50.0)[0, 0] == 4.5
    assert (learned.percentile(99.9)[1:] == 0.0).all()


def test_joints_of_a_jump_are_those_of_the_packets_of_its_two_steps() -> None:
    trace = made_up()
    trace.joints[:, 4] = trace.packet
    assert detector.jump_steps(trace, 1003)[:, 4].tolist() == [1001.0, 1002.0, 1003.0]
    assert np.isnan(detector.jump_steps(trace, 0)).all()


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


def test_leap_of_the_text_is_a_millimetre_within_two_packets() -> None:
    still = made_up()
    assert not detector.leaps(still)
    slow = made_up()
    slow.tip[:, 0] = np.arange(len(slow.tip)) * 450.0  # 0.9 mm in two packets
    assert not detector.leaps(slow)
    fast = made_up()
    fast.tip[:, 0] = np.arange(len(fast.tip)) * 550.0
    assert detector.leaps(fast)
