"""A stop rule against simulated users: what it promises holds however the data decide where it
stops.
"""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binom

from ravenjax.stats.intervals import anytime_bounds
from ravenjax.stats.sequential import Look, Sequential, Stratum


def rule(sizes=(1000,), rates=("harm",), half_width=0.03, shares=(0.1, 0.3, 1.0), **more):
    strata = tuple(Stratum(f"g{i}", size) for i, size in enumerate(sizes))
    return Sequential(strata, rates, half_width, shares, **more)


def course(one, cases):
    """Looks of a campaign whose draws are cases[rate][stratum] (bool [draws]) until it stops."""
    looks, taken = [], one.sizes()[0]
    while True:
        k = np.array([[of[:t].sum() for of, t in zip(rate, taken, strict=True)] for rate in cases])
        looks.append(one.decide(len(looks) + 1, taken, k, taken))
        if looks[-1].stop:
            return looks
        taken = one.next_sizes(looks[-1], k, taken)


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
    assert one.sizes()[0].tolist() == [40, 10]
    look = one.decide(1, one.sizes()[0], np.array([[0, 1]]), one.sizes()[0])
    assert [i.stratum for i in look.intervals] == ["dac"] and look.waiting == ("dac",)
    assert one.each == 0.95


def test_a_stratum_of_which_no_run_is_valid_is_waited_for():
    for of, waiting in (("groups", ("g1",)), ("whole", ("",))):
        one = rule((100, 100), of=of, half_width=0.4)
        look = one.decide(1, one.sizes()[0], np.array([[1, 0]]), np.array([10, 0]))
        assert not look.stop and look.waiting == waiting and look.widest == 1.0
        assert math.isnan(look.intervals[-1].value) and "NaN" not in look.model_dump_json()
        back = Look.model_validate_json(look.model_dump_json())
        assert back.model_dump_json() == look.model_dump_json() and math.isnan(
            back.intervals[-1].low
        )


@given(st.integers(0, 300), st.integers(0, 300), st.floats(0.01, 0.4), st.floats(1e-4, 0.3))
def test_bounds_at_any_time_are_a_test_of_every_rate(k, others, half_width, alpha):
    """A rate is outside exactly if a likelihood ratio against it exceeds 2/alpha."""
    n, rates = k + others, np.linspace(0.001, 0.999, 97)
    (low,), (high,) = anytime_bounds(np.array([k]), np.array([n]), alpha, half_width)
    assert 0 <= low <= high <= 1
    others = np.clip(rates + [[-half_width], [half_width]], 0, 1)
    ratio = (binom.logpmf(k, n, others) - binom.logpmf(k, n, rates)).max(axis=0)
    sure = np.abs(ratio - math.log(2 / alpha)) > 1e-6
    inside = (low < rates) & (rates < high)
    assert (inside == (ratio < math.log(2 / alpha)))[sure].all()


def test_any_look_is_covered():
    """2 000 users look after each of 300 draws; few ever see an interval without the truth."""
    random, steps = np.random.default_rng(3), np.arange(1, 301)
    low, high = anytime_bounds(*np.meshgrid(np.arange(301), steps, indexing="ij"), 0.05, 0.1)
    for rate in (0.02, 0.3):
        hits = (random.random((2000, 300)) < rate).cumsum(axis=1)
        missed = (low[hits, steps - 1] > rate) | (high[hits, steps - 1] < rate)
        assert missed.any(axis=1).mean() <= 0.05
        assert (high - low)[hits[:, -1], -1].mean() / 2 < 0.1, "wide intervals promise nothing"
