"""Points drawn here are those that SciPy draws, and leave the generator as SciPy leaves it."""

from __future__ import annotations

import warnings

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from scipy.stats import qmc

from ravenjax.campaign.faults import cube

OURS = {"lhs": (cube.latin_hypercube, qmc.LatinHypercube), "sobol": (cube.sobol, qmc.Sobol)}


@pytest.mark.parametrize("design", OURS)
@settings(max_examples=60, deadline=None)
@given(rows=st.integers(1, 300), dimensions=st.integers(1, 18), seed=st.integers(0, 2**32 - 1))
@example(rows=1, dimensions=16, seed=0)
@example(rows=256, dimensions=17, seed=1)
def test_the_same_points_and_the_same_generator_after_them(design, rows, dimensions, seed):
    ours, theirs = OURS[design]
    one, other = np.random.default_rng(seed), np.random.default_rng(seed)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        expected = theirs(dimensions, rng=other).random(rows)
    np.testing.assert_array_equal(ours(rows, dimensions, one), expected)
    assert one.random() == other.random() and one.spawn(1)[0].random() == other.spawn(1)[0].random()
