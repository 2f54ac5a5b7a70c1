"""Golden runs from window to window: computed once, dropped once no run needs them, joined in
order.
"""

from __future__ import annotations

from concurrent.futures import Future

import numpy as np

from ravenjax.campaign.golden_runs import Computed, GoldenRuns


def computed(numbers):
    """Golden runs whose series and outcomes are ten times their number."""
    numbers = np.asarray(numbers)
    return Computed(
        numbers, np.broadcast_to(10 * numbers, (4, 6, len(numbers))), {"count": 10 * numbers}
    )


class Engine:
    """Computes golden runs two by two, and remembers which."""

    def __init__(self):
        self.asked = []

    def __call__(self, numbers):
        self.asked.append(numbers.tolist())
        futures = [Future() for _ in range(0, len(numbers), 2)]
        for i, future in enumerate(futures):
            future.set_result(computed(numbers[2 * i : 2 * i + 2]))
        return futures


def test_a_window_computes_what_the_one_before_does_not_have():
    engine = Engine()
    golden_runs = GoldenRuns(np.zeros(0, int), ())
    for numbers in ([0, 1, 2, 5], [1, 3, 4, 5], [3, 4], [0, 6]):
        golden_runs = golden_runs.followed(np.array(numbers), engine)
        found = golden_runs.get()
        places = np.searchsorted(found.numbers, numbers)
        assert found.numbers[places].tolist() == numbers
        np.testing.assert_array_equal(found.reference[3, 2, places], 10 * np.array(numbers))
        np.testing.assert_array_equal(found.outcomes["count"][places], 10 * np.array(numbers))
    assert engine.asked == [[0, 1, 2, 5], [3, 4], [0, 6]]
    assert golden_runs.get().numbers.tolist() == [0, 6], "what no run needs any more is gone"


def test_nothing_is_computed_and_nothing_copied_where_all_are_there():
    engine = Engine()
    golden_runs = GoldenRuns(np.zeros(0, int), ()).followed(np.array([4]), engine)
    assert golden_runs.followed(np.array([4]), engine) is golden_runs
    assert golden_runs.get() is golden_runs.get()
    assert len(engine.asked) == 1
