"""Windows on clocks, by readings that are looked at one by one."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.faults.clocks import NEVER, Opening, PedalPhases

MOST = 40
WINDOW = st.tuples(
    st.integers(0, MOST + 5), st.sampled_from([1, 2, 9, 2**30]), st.sampled_from([0, 0, 7, 12])
)


def is_open(window, reading):
    start, duration, every = window
    since = reading - start
    return since >= 0 and (since % every if every else since) < duration


def opening(window):
    return Opening(*(np.array([number], np.int64) for number in window))


@given(WINDOW, st.integers(0, 12), st.integers(0, MOST))
def test_first_and_last_reading_of_a_window(window, low, length):
    readings = [reading for reading in range(low, low + length) if is_open(window, reading)]
    assert opening(window).first(low, low + length - 1)[0] == (readings[0] if readings else NEVER)
    assert opening(window).last(low, low + length - 1)[0] == (readings[-1] if readings else -1)


@given(WINDOW, st.lists(st.integers(1, 15), min_size=1, max_size=6), st.integers(0, 3), st.data())
def test_ticks_in_which_windows_of_the_pedal_are_open(window, lengths, later, data):
    bounds = np.cumsum([length + 2 * later for length in lengths])
    begins, ends = bounds[0::2][: len(bounds) // 2], bounds[1::2]
    ticks = int(bounds[-1]) + 3
    late = [data.draw(st.integers(0, later)) for _ in bounds]  # of each turn of the pedal
    turns = [int(bound) + delay for bound, delay in zip(bounds, late, strict=True)]
    phases = [(turns[i], turns[i + 1]) for i in range(0, len(turns) - 1, 2)]
    active = [
        tick for begin, end in phases for tick in range(begin, end) if is_open(window, tick - begin)
    ]
    known = PedalPhases(begins.astype(np.int64), ends.astype(np.int64), later)
    end = known.end(opening(window), ticks)[0]
    if later == 0:
        assert end == (active[-1] + 1 if active else 0)
    assert not active or active[-1] < end
    unknown = PedalPhases(known.begins, known.ends, None)
    assert unknown.end(opening(window), ticks)[0] == ticks
