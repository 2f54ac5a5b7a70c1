"""Brackets of functions whose crossings are known."""

import numpy as np
import pytest

from ravenjax.analyses.search.boundary import ALWAYS, CROSSING, NEVER, SearchRange, find_brackets

LOG, LINEAR = SearchRange(1.0, 10_000.0, True, 0.01), SearchRange(-5.0, 5.0, False, 0.001)


def thresholds(values):
    """Yes from the threshold of each cell on; counts its calls."""
    at = np.asarray(values, float)

    def asked(cell, number):
        asked.batches += 1
        asked.numbers += len(number)
        return (number >= at[cell]).astype(float)

    asked.batches = asked.numbers = 0
    return asked


@pytest.mark.parametrize("within", [LOG, LINEAR])
def test_known_thresholds_are_enclosed_to_the_tolerance(within):
    rng = np.random.default_rng(1)
    at = np.exp(rng.uniform(0.1, 9.0, 50)) if within.log else rng.uniform(-4.9, 4.9, 50)
    found = find_brackets(thresholds(at), within, np.zeros(50, bool), scan=9)
    assert (found.state == CROSSING).all() and found.monotone.all()
    assert (found.low < at).all() and (at <= found.high).all()
    widest = 0.01 * found.low if within.log else 0.001 * 10.0
    assert (found.high - found.low <= widest).all()


def test_whole_numbers_are_found_exactly():
    at = np.array([2, 3, 7, 55, 1234, 9999])
    tried: list[np.ndarray] = []

    def asked(cell, number):
        tried.append(number)
        return (number >= at[cell]).astype(float)

    found = find_brackets(asked, SearchRange(1.0, 10_000.0, True, 1e-6), np.ones(6, bool), scan=5)
    np.testing.assert_array_equal(found.high, at)
    np.testing.assert_array_equal(found.low, at - 1)
    assert all((numbers == np.rint(numbers)).all() for numbers in tried)


def test_cells_without_a_crossing_are_censored():
    found = find_brackets(thresholds([1e9, 0.5, 100.0]), LOG, np.zeros(3, bool), scan=5)
    assert found.state.tolist() == [NEVER, ALWAYS, CROSSING]
    assert found.low[0] == 10_000.0 and np.isnan(found.high[0])
    assert np.isnan(found.low[1]) and found.high[1] == 1.0
    assert found.monotone.all()


def test_a_window_of_harm_is_not_taken_for_a_threshold():
    def asked(cell, number):
        return ((number >= 10) & (number < 100) | (cell == 1) & (number > 1000)).astype(float)

    found = find_brackets(asked, LOG, np.zeros(2, bool), scan=33)
    assert not found.monotone.any()
    assert [len(changes) for changes in found.changes] == [2, 3]
    assert (found.low < 10).all() and (found.high >= 10).all() and (found.high < 10.2).all()
    low, high = found.changes[0][1]
    assert low < 100 <= high
