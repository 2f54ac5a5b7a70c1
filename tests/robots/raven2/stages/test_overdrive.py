"""Overdrive detection against a plain loop, and its quirks one by one."""

import numpy as np

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import overdrive

RAVEN2 = RavenSetup(arms=("gold", "green"), tools=("r_grasper",) * 2)


def run(commands, setup=RAVEN2, level=None, policy=1, runlevel=3, state=None):
    params = overdrive.params(setup, level, policy)
    state = state or overdrive.init(setup)
    given = tuple(Vec(map(np.int32, arm)) for arm in commands)
    state, checked, tripped = overdrive.step(
        setup, params, state, np.int32(9), np.int32(runlevel), given
    )
    return state, [[int(x) for x in arm] for arm in checked], bool(tripped)


REST = [0] * 7


def test_over_the_instant_limit_that_joint_is_zeroed_and_the_others_are_still_written():
    state, checked, tripped = run([[-20001, 20000, 0, 0, 0, 0, 5], REST], runlevel=0)
    assert (checked[0], tripped) == ([0, 20000, 0, 0, 0, 0, 5], True)
    assert (
        int(state.instant.first_tick),
        int(state.instant.count),
        float(state.instant.margin),
    ) == (9, 1, -1.0)
    _, checked, _ = run([[-20001, 9000, 0, 0, 0, 0, 5], REST])
    assert checked[0][:2] == [0, 2500]


def test_hard_regulation_trips_on_the_twelfth_sample_then_after_eleven_more():
    state, trips = None, []
    for sample in range(1, 40):
        state, checked, tripped = run([REST, [0, 0, 2001, 0, 0, 0, 0]], policy=2, state=state)
        assert checked[1][2] == (0 if tripped else 2001)
        trips += [sample] if tripped else []
        state, _, _ = run([REST, REST], policy=2, state=state)  # cycles in range reset nothing
    assert trips == [12, 23, 34]
    assert (int(state.hard.count), float(state.hard.margin)) == (3, 0.0)
