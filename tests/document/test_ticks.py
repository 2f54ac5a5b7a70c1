"""Ticks: round, within the axis, as many as asked for, and told apart."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.document import ticks

spans = st.tuples(st.floats(-1e6, 1e6), st.floats(1e-9, 1e6)).filter(
    lambda pair: pair[1] > 1e-6 * abs(pair[0])
)


@given(spans, st.integers(2, 9))
def test_linear_ticks_lie_within_and_have_labels_of_their_own(span, most):
    low, high = span[0], span[0] + span[1]
    values = ticks.linear(low, high, most)
    slack = 1e-6 * (high - low)
    assert len(values) <= most + 1 and all(low - slack <= value <= high + slack for value in values)
    assert (
        len(set(ticks.labels(values))) == len(values) == len(set(ticks.labels(values, share=True)))
    )


@pytest.mark.parametrize("most", [0.4, 0.05, 0.02, 0.004, 3e-5])
def test_small_shares_are_never_all_zero_percent(most):
    labels = ticks.labels(ticks.linear(0, most, 6), share=True)
    numbers = [float(label.removesuffix("\u202f%")) for label in labels]
    assert numbers == pytest.approx([100 * value for value in ticks.linear(0, most, 6)])
    assert labels[0].startswith("0") and len(set(labels)) == len(labels) >= 3


@pytest.mark.parametrize(
    ("low", "high", "most", "labels"),
    [
        (1, 3000, 8, ["1", "3", "10", "30", "100", "300", "1,000", "3,000"]),
        (1, 3000, 5, ["1", "10", "100", "1,000"]),
        (0.5, 20, 8, ["0.5", "1", "2", "5", "10", "20"]),
        (1, 1e9, 5, ["1", "100", "10,000", "1,000,000", "100,000,000"]),
    ],
)
def test_logarithmic_ticks(low, high, most, labels):
    assert ticks.labels(ticks.logarithmic(low, high, most)) == labels


def test_signs_and_thousands():
    assert ticks.labels([-1500, 0, 1500]) == ["−1,500", "0", "1,500"]
    assert ticks.labels([-0.05, 0.0, 0.05]) == ["−0.05", "0", "0.05"]


@given(st.floats(1e-6, 1e6))
def test_the_end_of_an_axis_is_a_tick_above_the_value(value):
    end = ticks.above(value)
    assert value <= end * (1 + 1e-9) and end <= 2 * value + 1e-12
    values = ticks.linear(0, end, 5)
    assert (
        values[0] == 0 and values[-1] == pytest.approx(end) and np.ptp(np.diff(values)) < 1e-9 * end
    )
