"""A stop rule against simulated users: what it promises holds however the data decide where it
stops.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ravenjax.stats.intervals import rate_bounds
from ravenjax.stats.sample_size.sequential import Look, Sequential, Stratum, wilson_runs


def rule(sizes=(1000,), rates=("harm",), half_width=0.03, shares=(0.1, 0.3, 1.0), **more):
    strata = tuple(Stratum(f"g{i}", size) for i, size in enumerate(sizes))
    return Sequential(strata, rates, half_width, shares, **more)


def course(one, cases):
    """Looks of a campaign whose draws are cases[rate][stratum] (bool [draws]) until it stops."""
    looks, taken = [], one.first()
    while True:
        k = np.array([[of[:t].sum() for of, t in zip(rate, taken, strict=True)] for rate in cases])
        looks.append(one.look(len(looks) + 1, taken, k, taken))
        if looks[-1].stop:
            return looks
        taken = one.following(looks[-1], k, taken)


@pytest.mark.slow
@pytest.mark.parametrize("allocation", ["proportional", "neyman"])
def test_all_intervals_of_all_looks_hold_together(allocation):
    """Two strata and two rates; a user is wrong who ever sees one interval without its truth."""
    random, tries = np.random.default_rng(0), 300
    truth = np.array([[0.1, 0.4], [0.02, 0.15]])
    one = rule((600, 400), ("a", "b"), 0.11, (0.05, 0.1, 0.2, 0.4, 0.7, 1.0), allocation=allocation)
    wrong = early = 0
    for _ in range(tries):
        looks = course(
            one,
            [
                [random.random(s.size) < p for s, p in zip(one.strata, row, strict=True)]
                for row in truth
            ],
        )
        seen = [
            (i, truth["ab".index(i.rate)][int(i.stratum[1])])
            for look in looks
            for i in look.intervals
        ]
        wrong += any(not i.low <= p <= i.high for i, p in seen)
        early += looks[-1].number < 6
    assert wrong / tries <= 0.05
    assert early / tries > 0.9, "it would promise little to those who never stop"


@pytest.mark.slow
@pytest.mark.parametrize("allocation", ["proportional", "neyman"])
def test_the_rate_of_the_whole_table_is_covered(allocation):
    random, tries = np.random.default_rng(2), 300
    sizes, truth = (4000, 2000, 1000), np.array([0.02, 0.3, 0.08])
    one = rule(
        sizes, half_width=0.02, of="whole", allocation=allocation, shares=(0.05, 0.1, 0.2, 0.4, 1.0)
    )
    whole, wrong, used = truth @ sizes / sum(sizes), 0, 0
    for _ in range(tries):
        looks = course(
            one, [[random.random(size) < p for size, p in zip(sizes, truth, strict=True)]]
        )
        wrong += any(not i.low <= whole <= i.high for look in looks for i in look.intervals)
        used += sum(looks[-1].taken.values())
    assert wrong / tries <= 0.05
    assert used / tries < 0.6 * sum(sizes)


def test_neyman_needs_fewer_runs_than_proportional():
    """Half of the table is a stratum in which next to nothing happens."""
    truth, sizes, used = (0.001, 0.5), (20_000, 20_000), {}
    random = np.random.default_rng(4)
    cases = [[random.random(size) < p for size, p in zip(sizes, truth, strict=True)]]
    for of in ("groups", "whole"):
        for allocation in ("proportional", "neyman"):
            shares = tuple(np.linspace(0.02, 1, 50).round(3).tolist())
            looks = course(
                rule(sizes, half_width=0.01, of=of, allocation=allocation, shares=shares), cases
            )
            assert not looks[-1].waiting
            used[of, allocation] = sum(looks[-1].taken.values())
    assert used["groups", "neyman"] < 0.65 * used["groups", "proportional"]
    assert used["whole", "neyman"] < 0.75 * used["whole", "proportional"]


SIZES = st.lists(st.integers(1, 300), min_size=1, max_size=4)
SHARES = st.lists(st.integers(1, 100), min_size=1, max_size=6, unique=True).map(
    lambda x: tuple(i / 100 for i in sorted(x))
)


@pytest.mark.slow
@given(
    st.data(),
    SIZES,
    SHARES,
    st.sampled_from(["groups", "whole"]),
    st.sampled_from(["proportional", "neyman"]),
)
def test_any_course_ends_and_keeps_to_what_was_registered(data, sizes, shares, of, allocation):
    one = rule(
        sizes, ("a", "b"), data.draw(st.floats(0.01, 0.3)), shares, of=of, allocation=allocation
    )
    random = np.random.default_rng(data.draw(st.integers(0, 99)))
    cases = [[random.random(size) < random.random() for size in sizes] for _ in "ab"]
    looks = course(one, cases)
    assert [look.number for look in looks] == list(range(1, len(looks) + 1)) and len(looks) <= len(
        shares
    )
    taken = np.array([list(look.taken.values()) for look in looks])
    assert (
        (np.diff(taken, axis=0) >= 0).all()
        and (taken >= 1).all()
        and (taken <= one.sizes()[-1]).all()
    )
    assert all((taken[:, s] == one.sizes()[:, [s]]).any(axis=0).all() for s in range(len(sizes)))
    last = looks[-1]
    wide = {i.stratum for i in last.intervals if i.half_width > one.half_width}
    held = {stratum.name: stratum.size for stratum in one.strata}
    open_still = {name for name in held if last.taken[name] < held[name]}
    assert set(last.waiting) == {
        name for name in wide if (open_still if name == "" else name in open_still)
    }
    assert last.number == len(shares) or not last.waiting
    assert [
        Look.model_validate_json(look.model_dump_json()).model_dump_json() for look in looks
    ] == [look.model_dump_json() for look in looks]
    assert course(one, cases) == looks, "nothing but the data decides"


def test_strata_that_are_not_judged_are_taken_at_once():
    free = Stratum("free", 40, judged=False)
    one = Sequential((free, Stratum("dac", 100)), ("harm",), 0.1, (0.1, 1.0))
    assert one.first().tolist() == [40, 10]
    look = one.look(1, one.first(), np.array([[0, 1]]), one.first())
    assert [i.stratum for i in look.intervals] == ["dac"] and look.waiting == ("dac",)
    assert one.each == 1 - 0.05 / 2


def test_a_stratum_of_which_no_run_is_valid_is_waited_for():
    for of, waiting in (("groups", ("g1",)), ("whole", ("",))):
        one = rule((100, 100), of=of, half_width=0.4)
        look = one.look(1, one.first(), np.array([[1, 0]]), np.array([10, 0]))
        assert not look.stop and look.waiting == waiting and look.widest == 1.0
        assert math.isnan(look.intervals[-1].value) and "NaN" not in look.model_dump_json()
        back = Look.model_validate_json(look.model_dump_json())
        assert back.model_dump_json() == look.model_dump_json() and math.isnan(
            back.intervals[-1].low
        )


@given(st.floats(0, 1), st.integers(1, 10**6), st.floats(1e-4, 0.49), st.floats(0.5, 0.9999))
def test_more_runs_are_the_fewest_whatever_is_asked(rate, n, half_width, confidence):
    k = round(rate * n)
    total = max(n, int(wilson_runs(np.array(k / n), half_width, confidence)))
    runs = np.array([total, total - 1.0])
    low, high = rate_bounds(k / n * runs, runs, 1 - confidence)
    enough, fewer = (high - low) / 2
    assert enough <= half_width * (1 + 1e-8) and (total == n or fewer > half_width * (1 - 1e-8))
