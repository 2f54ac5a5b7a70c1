"""The same work on many things: in order, in as many threads as asked for, errors first come."""

import threading
import time

import pytest

from ravenjax import threads


@pytest.mark.parametrize("most", [1, 2, 5])
def test_no_more_run_at_a_time_than_asked_for(most):
    now, peak, lock = 0, 0, threading.Lock()

    def one(_: int) -> None:
        nonlocal now, peak
        with lock:
            now += 1
            peak = max(peak, now)
        time.sleep(0.02)
        with lock:
            now -= 1

    threads.map_in_threads(one, range(20), most)
    assert peak == most


def test_the_first_error_is_raised_and_what_has_not_begun_is_left():
    begun: list[int] = []

    def one(number: int) -> None:
        begun.append(number)
        time.sleep(0.01)
        if number == 2:
            raise ValueError(f"of {number}")

    with pytest.raises(ValueError, match="of 2"):
        threads.map_in_threads(one, range(1000), 2)
    assert len(begun) < 100
