"""Counting of cells, intervals over them, bias and bands, on numbers whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest

from ravenjax.studies.dsn16 import cells as dsn16_cells
from ravenjax.studies.dsn16.cells import bias, difference, in_band, inside, means, rate


def test_means_are_the_share_of_each_cell() -> None:
    value = np.array([5.0, 5.0, 1.0, 1.0, 5.0, 1.0])
    duration = np.array([2, 2, 2, 2, 8, 8])
    cells = means(value, duration, np.array([True, False, True, True, False, True]))
    assert cells.values.tolist() == [1.0, 5.0]
    assert cells.durations.tolist() == [2, 8]
    assert cells.shares.tolist() == [[1.0, 1.0], [0.5, 0.0]]
    assert cells.of(8).tolist() == [1.0, 0.0]
    assert cells.alike == 3


def test_a_cell_without_runs_is_no_rate() -> None:
    cells = means(np.array([1.0, 2.0]), np.array([1, 2]), np.array([True, True]))
    assert np.isnan(cells.shares[0, 1]) and np.isnan(cells.shares[1, 0])
    with pytest.raises(KeyError, match=r"no fault lasts 4 packets; there are \[1, 2\]"):
        cells.of(4)


def test_cells_are_ordered_by_magnitude_whatever_the_sign() -> None:
    positive = means(np.array([1.0, 10.0, 5.0]), np.ones(3, int), np.array([False, True, False]))
    negative = means(np.array([-1.0, -10.0, -5.0]), np.ones(3, int), np.array([False, True, False]))
    assert positive.by_size.tolist() == negative.by_size.tolist() == [[0.0], [0.0], [1.0]]


def test_rate_counts_cells_not_runs() -> None:
    """Half of 16 cells: the interval is that of 16 units, however many runs are in each."""
    found = rate(np.repeat([0.0, 1.0], 8))
    assert (found.value, found.n, found.of) == (50.0, 16, "cells")
    width = found.high - found.low
    assert 40.0 < width < 56.0  # binomial: 2 * 1.96 * sqrt(0.25 / 16) = 49 points; of 160 runs it would be 15
    assert found.low < 50.0 < found.high


def test_rate_of_agreeing_cells_keeps_a_bound() -> None:
    none, every = rate(np.zeros(17)), rate(np.ones(17))
    assert (none.value, none.low) == (0.0, 0.0)
    assert none.high == pytest.approx(19.5, abs=0.1)  # Clopper-Pearson, 0 of 17
    assert (every.value, every.high) == (100.0, 100.0)
    assert every.low == pytest.approx(100.0 - none.high)
    half = rate(np.full(10, 0.5))
    assert half.low <= half.value <= half.high


def test_rate_needs_shares() -> None:
    with pytest.raises(ValueError, match=r"needs shares \[n\]"):
        rate(np.zeros(0))


def test_difference_is_paired() -> None:
    base = np.tile([0.0, 1.0], 50)
    shifted = base.copy()
    shifted[0] = 1.0
    found = difference(shifted, base)
    assert found.value == pytest.approx(1.0)
    assert found.low == 0.0 and found.high <= 4.0  # unpaired, the spread of the cells would make it some 14 points
    assert difference(base, base).high == 0.0


def test_sign_test_leaves_ties_and_reading_errors_out() -> None:
    published = np.array([0.0, 0.0, 5.0, 27.0, 37.0, 61.0, 68.0, 65.0])
    low = bias(published - np.array([0, 0, 5, 9, 9, 9, 9, 9]), published)
    assert (low.above, low.below, low.p) == (0, 6, pytest.approx(2 * 0.5**6))
    assert low.words == "0 above, 6 below"
    close = bias(published + 0.5, published, reading_error=0.6)
    assert (close.above, close.below, close.p) == (0, 0, 1.0)
    assert bias(published + np.tile([3, -3], 4), published).p == 1.0


def test_band_includes_its_ends() -> None:
    assert in_band(10.9, (10.9, 44.2)) and in_band(44.2, (10.9, 44.2))
    assert not in_band(10.8, (10.9, 44.2))
    assert in_band(0.0, (0.0, 0.0)) and not in_band(0.6, (0.0, 0.0))


@pytest.mark.parametrize("cycles", [1, 2])
def test_published_window_counts_packets(cycles: int) -> None:
    """A jump at packet i ends with packet i + 2, which begins in tick (i + 1) * cycles."""
    packets = np.array([999, 1000, 1005, 1006])
    ticks = (packets + 1) * cycles
    found = inside(ticks, np.full(4, 1000), np.full(4, 4), cycles)  # window 1000 .. 1000 + 4 + 1
    assert found.tolist() == [False, True, True, False]
    assert not inside(np.array([-1]), np.array([1000]), np.array([4]), cycles)[0]


def test_durations_are_those_of_the_publication() -> None:
    assert dsn16_cells.DURATIONS == (1, 2, 4, 8, 16, 32, 64, 128)
