"""Time is shared out so that the whole stays within what was asked for, on slow machines, too."""

from __future__ import annotations

import pytest

from ravenjax.bench import parts
from ravenjax.bench.effort import FULL_S, QUICK_S, Allotment, PartCost

SHORT, LONG = PartCost(2.0, 1.0, 5.0), PartCost(10.0, 1.0, 9.0)


def spend(total, costs, slower):
    """(seconds spent, shares) on a machine so many times slower than the one that costs are
    from.
    """
    allotment, spent, shares = Allotment(total), 0.0, []
    for number, cost in enumerate(costs):
        share = allotment.share(cost, costs[number + 1 :])
        shares.append(share)
        if share is not None:
            took = cost.usual_s * slower + share
            allotment.done(cost, share, took)
            spent += took
    return spent, shares


def test_what_is_left_is_shared_by_weight():
    allotment = Allotment(20.0)  # 14 are needed
    assert allotment.share(SHORT, [LONG]) == pytest.approx(1.0 + 6.0 * 4.0 / 12.0)
    assert Allotment(100.0).share(SHORT, [LONG]) == 5.0  # no more than says something
    assert Allotment(100.0).share(PartCost(1.0, 0.0, 0.0), []) == 0.0


def test_parts_that_no_longer_fit_are_left_out():
    assert Allotment(2.9).share(SHORT, []) is None
    assert Allotment(3.0).share(SHORT, [LONG]) == 1.0  # the first goes before all later ones
    _, shares = spend(12.0, [SHORT, LONG, SHORT], 1.0)
    assert shares[0] is not None and shares[1] is None and shares[2] is not None


def test_a_slow_machine_is_noticed():
    allotment = Allotment(1000.0)
    allotment.done(LONG, 1.0, 31.0)
    assert allotment.slowness == pytest.approx(40.0 / 20.0)
    assert allotment.needs(SHORT) == pytest.approx(2.0 * 2.0 + 1.0)
    for _ in range(9):
        allotment.done(LONG, 0.0, 1e6)
    assert allotment.slowness == 20.0


@pytest.mark.parametrize("slower", [0.5, 1.0, 1.5, 3.0, 8.0])
@pytest.mark.parametrize("quick", [False, True])
def test_the_whole_stays_below_its_time(slower, quick):
    """But for how slow the machine turns out to be in the part that is under way."""
    costs = [part.cost for part in parts.wanted(quick, (), 0) if not part.needs_gpu]
    total = QUICK_S if quick else FULL_S
    spent, shares = spend(total, costs, slower)
    late = max(cost.usual_s for cost in costs[:3]) * max(0.0, slower - 1.0)
    assert spent <= total + late
    if slower <= 1.0:
        assert None not in shares


def test_the_full_benchmark_needs_less_than_three_minutes_of_two_quiet_cores():
    costs = [part.cost for part in parts.wanted(False, (), 0) if not part.needs_gpu]
    assert (
        sum(cost.usual_s + cost.least_s for cost in costs) + parts.MACHINE_COST.usual_s
        < FULL_S
        < 180.0
    )
