"""Counting of cells, bias and bands, on numbers whose answers are known."""

from __future__ import annotations

import numpy as np
import pytest

from studies.dsn16.attacks import bias, inside, means, rate


def test_means_are_the_share_of_each_cell() -> None:
    value = np.array([5.0, 5.0, 1.0, 1.0, 5.0, 1.0])
    duration = np.array([2, 2, 2, 2, 8, 8])
    cells = means(value, duration, np.array([True, False, True, True, False, True]))
    assert cells.values.tolist() == [1.0, 5.0]
    assert cells.durations.tolist() == [2, 8]
    assert cells.shares.tolist() == [[1.0, 1.0], [0.5, 0.0]]
    assert cells.of(8).tolist() == [1.0, 0.0]


def test_a_cell_without_runs_is_no_rate() -> None:
    cells = means(np.array([1.0, 2.0]), np.array([1, 2]), np.array([True, True]))
    assert np.isnan(cells.shares[0, 1]) and np.isnan(cells.shares[1, 0])
    with pytest.raises(KeyError, match=r"no fault lasts 4 packets; there are \[1, 2\]"):
        cells.of(4)


def test_rate_counts_cells_not_runs_and_a_grid_has_no_interval() -> None:
    """However many runs are in each: cells are a fixed grid, nothing is sampled."""
    result = rate(np.repeat([0.0, 1.0], 8))
    assert (result.value, result.n, result.of) == (50.0, 16, "cells of a fixed grid")
    assert np.isnan(result.low) and np.isnan(result.high)


def test_sign_test_leaves_ties_and_reading_errors_out() -> None:
    published = np.array([0.0, 0.0, 5.0, 27.0, 37.0, 61.0, 68.0, 65.0])
    low = bias(published - np.array([0, 0, 5, 9, 9, 9, 9, 9]), published)
    assert (low.above, low.below, low.p) == (0, 6, pytest.approx(2 * 0.5**6))
    assert low.words == "0 above, 6 below"
    close = bias(published + 0.5, published, reading_error=0.6)
    assert (close.above, close.below, close.p) == (0, 0, 1.0)
    assert bias(published + np.tile([3, -3], 4), published).p == 1.0


def test_published_window_counts_packets() -> None:
    """A jump at packet i ends with packet i + 2."""
    packets = np.array([999, 1000, 1005, 1006])
    result = inside(packets + 2, np.full(4, 1000), np.full(4, 4))  # window 1000 .. 1000 + 4 + 1
    assert result.tolist() == [False, True, True, False]
    assert not inside(np.array([0]), np.array([1000]), np.array([4]))[0]
