"""Runs cost what comes after their fault; the cost is told by when it strikes."""

from __future__ import annotations

import pytest
from made_up_findings import fault_time

from ravenjax.bench import fault_times
from ravenjax.bench.fault_times import FaultTimes
from ravenjax.campaign import plan


def test_the_line_goes_through_runs_that_are_observed_to_their_end():
    times = [
        fault_time(start, None, 1e-4 + 1e-4 * (10_000 - start) / 1e3) for start in (0, 2500, 9000)
    ]
    found = FaultTimes("simd", 10_000, 8, (*times, fault_time(0, 100, 5.0)))
    assert found.line == pytest.approx((1e-4, 1e-4)) and found.whole_s == pytest.approx(1.1e-3)


@pytest.mark.parametrize(
    ("start", "observe", "after"),
    [(0, None, 100), (60, None, 40), (0, 20, 30), (60, 20, 30), (90, 20, 10)],
)
def test_the_length_after_the_fault_is_what_is_observed(start, observe, after):
    """The fault lasts 10 ms; what is observed ends with the run."""
    ready = plan.make_plan(fault_times.campaign(4, start, observe, 100))
    assert ready.runs == 4 and fault_times.after_ms(ready) == after
    assert len(set(ready.faults["value"].ravel().tolist())) == 4


def test_every_time_is_measured_both_ways(tmp_path, monkeypatch):
    monkeypatch.setenv("RAVENJAX_CACHE", str(tmp_path))
    found = fault_times.measure(0.05, "simd", 60, 20, (0.0, 0.5), 32)
    assert [(one.start_ms, one.observe_ms, one.after_ms) for one in found.times] == [
        (0, None, 60),
        (30, None, 30),
        (0, 20, 30),
        (30, 20, 30),
    ]
    assert (
        found.runs >= 32
        and found.ticks == 60
        and min(one.run_s.smallest for one in found.times) > 0.0
    )
