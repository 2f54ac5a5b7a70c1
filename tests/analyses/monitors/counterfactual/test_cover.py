"""Greedy cover beside every set that there is, on small random instances."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from ravenjax.analyses.monitors.counterfactual.check_set import select_greedily

INSTANCES = arrays.arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 6)))


def count_covered(covered, members):
    return covered[:, list(members)].any(axis=1).sum()


@pytest.mark.slow
@given(INSTANCES, st.integers(1, 6))
def test_it_covers_its_share_of_what_the_best_set_of_its_size_does(covered, most):
    members = select_greedily(covered, most)
    assert len(set(members)) == len(members) <= most
    sets = itertools.combinations(range(covered.shape[1]), min(most, covered.shape[1]))
    best = max(count_covered(covered, one) for one in sets)
    assert count_covered(covered, members) >= (1 - np.exp(-1)) * best - 1e-9


@pytest.mark.slow
@given(INSTANCES)
def test_with_room_for_all_it_covers_all_and_holds_nothing_superfluous(covered):
    members = select_greedily(covered, covered.shape[1])
    assert count_covered(covered, members) == covered.any(axis=1).sum()
    for one in members:
        others = [other for other in members if other != one]
        assert count_covered(covered, others) < count_covered(covered, members)


@pytest.mark.parametrize(("least", "size"), [(0.0, 2), (0.05, 2), (0.2, 1)])
def test_a_candidate_that_adds_too_little_is_not_taken(least, size):
    covered = np.zeros((10, 2), bool)
    covered[:9, 0] = covered[9, 1] = True
    assert len(select_greedily(covered, 2, min_gain=least)) == size
