"""Counted delays give what the delays themselves give."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.report.data import counted
from ravenjax.stats import latency

RUNS = st.lists(st.tuples(st.integers(0, 9), st.booleans()), max_size=40)


def delays(times, came):
    both, count = np.unique(np.stack([times, came]), axis=1, return_counts=True)
    return counted.Delays(both[0], both[1].astype(bool), count)


def arrays(runs):
    return np.array([time for time, _ in runs], int), np.array([came for _, came in runs], bool)


def same(one, other):
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=0, atol=1e-12)


@given(RUNS)
def test_incidence(runs):
    times, came = arrays(runs)
    one, other = counted.incidence(delays(times, came)), latency.incidence(times, came)
    same(one, other)
    for share in (0.25, 0.5):
        np.testing.assert_equal(one.quantile_interval(share), other.quantile_interval(share))


@given(RUNS, st.integers(0, 9))
def test_lead(runs, harm):
    times, came = arrays(runs)
    alarm, end = np.where(came, times, np.nan), 9.0
    one = counted.lead(delays(np.where(came, times, end).astype(int) - harm, came))
    other = latency.lead_time(alarm, np.full(len(times), float(harm)), end)
    same(one.lag, other.lag)
    np.testing.assert_equal(
        (*one.before, one.alarmed, one.n), (*other.before, other.alarmed, other.n)
    )


@given(st.lists(st.integers(-5, 5), min_size=1))
def test_median(values):
    different, count = np.unique(values, return_counts=True)
    assert counted.median(different[::-1], count[::-1]) == np.median(values)


def test_without_runs():
    nothing = counted.Delays(np.zeros(0, int), np.zeros(0, bool), np.zeros(0, int))
    assert counted.incidence(nothing).n == 0 and counted.lead(nothing).n == 0
    assert np.isnan(counted.median(nothing.time, nothing.count)) and nothing.n == 0
    assert counted.incidence(nothing).quantile(0.5) == pytest.approx(np.nan, nan_ok=True)
