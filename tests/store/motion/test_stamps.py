"""When rows were sampled: which columns say so, and every way in which they cannot be believed."""

import numpy as np
import pytest
from recorded_hands import ROWS, circle, play, recording, refused, table, tip_mm

SLOW = np.arange(90) / 30.0
"""A camera's 30 rows a second."""


@pytest.mark.parametrize(
    ("name", "per_s"), [("time_s", 1.0), ("t_s", 1.0), ("t_ms", 1e3), ("timestamp_ns", 1e9)]
)
def test_a_time_column_is_taken_in_its_unit(parquet, name, per_s):
    """`t_ms` was ignored, each row taken as a millisecond: a file of 30 rows a second ran 33
    times too fast.
    """
    frame = table(SLOW).assign(**{name: np.rint(SLOW * per_s * 1e3) / 1e3})
    one = play(parquet(frame))
    assert one.summary.clock == f"column {name}"
    assert one.summary.rate_hz == pytest.approx(30.0, rel=1e-3)
    assert one.motion.duration_s == pytest.approx(2.967 + 0.75, abs=2e-3)
    assert np.ptp(tip_mm(one.motion), axis=0) == pytest.approx([6.0, 20.0, 0.0], abs=0.02)


@pytest.mark.parametrize("kind", [np.int64, np.uint64, np.float64])
def test_nanoseconds_since_1970_lose_nothing(parquet, kind):
    frame = recording().drop(columns="time_s")
    time_ns = 1_422_318_506_000_000_000 + np.arange(ROWS) * 1_000_000
    exact = play(parquet(frame.assign(time_ns=time_ns.astype(kind))))
    assert exact.summary.rate_hz == pytest.approx(1000.0, rel=1e-6)
    plain = play(parquet(recording()))
    assert np.abs(tip_mm(exact.motion) - tip_mm(plain.motion)).max() < (
        1e-9 if kind is not np.float64 else 1e-5
    )


def test_a_file_without_times_needs_a_rate(parquet):
    path = parquet(table(np.arange(ROWS) * 1e-3))
    refused(
        path,
        f"the times of its {ROWS} rows are unknown",
        "operator.rate_hz = 1000 for one row per milli",
    )
    one = play(path, rate_hz=1000.0)
    assert one.summary.clock == "operator.rate_hz = 1000"
    assert len(one.motion) == ROWS + 749


@pytest.mark.parametrize(("name", "factor"), [("time_ms", 1.0), ("time_s", 1e3)])
def test_a_unit_that_makes_an_impossible_rate(parquet, name, factor):
    frame = table(SLOW).assign(**{name: SLOW * factor})
    refused(parquet(frame), "rows a second", "expected 10 to 20000 a second", "_ms, _us or _ns")


def test_a_gap_says_where_how_long_and_what_to_write(parquet):
    time_s = np.arange(ROWS) * 1e-3
    time_s[1200:] += 0.75
    time_s[2000:] += 0.2
    path = parquet(table(time_s).assign(time_s=time_s))
    message = refused(
        path, "gap of 0.751 s after row 1199 (t = 1.199 s); expected at most 0.1 s", "2 such gaps"
    )
    assert "operator.window_s within [0.000, 1.200], [2.950, 3.950], [1.950, 2.750] s" in message
    assert "operator.max_gap_s = 0.76" in message
    part = play(path, window_s=(1.95, 2.75))
    assert (
        part.summary.gaps == 2
        and part.summary.longest_gap[0] == 1199
        and part.summary.outside_share > 0.2
    )
    bridged = play(path, max_gap_s=0.76)
    assert bridged.summary.longest_gap[2] == pytest.approx(0.751)
    shown = tip_mm(bridged.motion)[
        749:
    ]  # the circle goes on through the gap, to within what the gap hides
    wanted = circle(np.arange(len(shown)) * 1e-3)
    assert np.abs(shown - wanted)[300:1100].max() < 1e-3
    assert 0.01 < np.abs(shown - wanted)[1200:1950].max() < 2.0
