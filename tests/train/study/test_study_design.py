"""The design of a study: assignments, and the floor that a plan states is the p that `study` itself
reaches with the largest effect there is.
"""

import numpy as np
import pytest

from ravenjax.stats import multiplicity
from ravenjax.stats.comparison import clustered
from ravenjax.train.study import design

PEOPLE = [f"P{i:02d}" for i in range(12)]


def test_assignment_is_balanced_in_every_block_and_the_same_again():
    got = design.assign_groups(PEOPLE, ["a", "b", "c"], seed=11)
    assert got == design.assign_groups(PEOPLE, ["a", "b", "c"], seed=11)
    assert got != design.assign_groups(PEOPLE, ["a", "b", "c"], seed=12)
    for block in (0, 1):
        names = [one.group for one in got if one.block == block]
        assert sorted(names) == ["a", "a", "b", "b", "c", "c"]
    longer = design.assign_groups([*PEOPLE, "late"], ["a", "b", "c"], seed=11)
    assert longer[:12] == got and longer[12].block == 2
    assert [one.participant for one in got] == PEOPLE


def largest(n, paired):
    """p of a difference without any overlap."""
    first, second = ([np.array([base + i]) for i in range(n)] for base in (0.0, 1000.0))
    return clustered.permutation_p(first, second, is_paired=paired)


@pytest.mark.parametrize("n", [2, 3, 6, 8, 13, 14, 30])
def test_the_floor_of_pairs_is_what_the_test_reaches(n):
    assert design.smallest_p(n) == pytest.approx(largest(n, True), rel=0.02)


@pytest.mark.parametrize("n", [2, 3, 4, 7, 20])
def test_the_floor_of_two_groups_is_what_the_test_reaches(n):
    assert design.smallest_p(2 * n, paired=False) == pytest.approx(largest(n, False), rel=0.02)


def test_six_pairs_can_never_be_clear_over_four_outcomes():
    found = design.plan_study(6)
    assert (found.smallest_p, found.adjusted, found.possible) == (0.03125, 0.125, False)
    holm = multiplicity.holm_test({str(i): found.smallest_p for i in range(4)})
    assert [one.adjusted for one in holm.values()] == [pytest.approx(found.adjusted)] * 4
    text = design.describe_plan(found)
    assert (
        "the smallest p is 0.0312; after Holm over 4 comparisons 0.125" in text
        and "no result can be clear" in text
    )


def test_an_effect_needs_more_and_a_smaller_one_more_still():
    large, small = (design.plan_study(6, effect=effect).for_effect for effect in (1.0, 0.5))
    assert design.plan_study(6).needed == 8 < large < small
    # 33.4 pairs for d 0.5, power 0.8 and one test (Cohen 1988), so 34
    assert design.plan_study(6, outcomes=1, effect=0.5).for_effect == 34
