"""Overdrive detection against a plain loop, and its quirks one by one."""

from __future__ import annotations

import numpy as np

from ravenjax.numbers.vec import Vec
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import overdrive

RAVEN2 = RavenSetup(arms=("gold", "green"), tools=("r_grasper",) * 2)
FORK = RavenSetup(arms=("gold", "green"), tools=("r_grasper_B",) * 2, software="fork2015")


def run(commands, setup=RAVEN2, level=None, policy=1, runlevel=3, state=None):
    params = overdrive.params(setup, level, policy)
    state = state or overdrive.init(setup)
    given = tuple(Vec(map(np.int32, arm)) for arm in commands)
    state, checked, tripped = overdrive.step(
        setup, params, state, np.int32(9), np.int32(runlevel), given
    )
    return state, [[int(x) for x in arm] for arm in checked], bool(tripped)


REST = [0] * 7


def test_default_policy_clips_to_the_level():
    _, checked, tripped = run(
        [[9000, -9000, 9000, 9000, -9000, 9000, 9000], [2500, -2500, 2000, 3000, 3000, 3800, 0]]
    )
    assert checked == [
        [2500, -2500, 2000, 3000, -3000, 3800, 9000],
        [2500, -2500, 2000, 3000, 3000, 3800, 0],
    ]
    assert not tripped


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


def test_the_forks_limits():
    _, checked, tripped = run([[12_000, -12_000, 9000, 7000, 3000, 5000, 9000], REST], FORK)
    assert (checked[0], tripped) == ([10_000, -10_000, 8000, 6000, 2700, 4800, 9000], False)
    assert run([[12_001, *REST[1:]], REST], FORK)[2]


def test_hard_regulation_trips_on_the_twelfth_sample_then_after_eleven_more():
    state, trips = None, []
    for sample in range(1, 40):
        state, checked, tripped = run([REST, [0, 0, 2001, 0, 0, 0, 0]], policy=2, state=state)
        assert checked[1][2] == (0 if tripped else 2001)
        trips += [sample] if tripped else []
        state, _, _ = run([REST, REST], policy=2, state=state)  # cycles in range reset nothing
    assert trips == [12, 23, 34]
    assert (int(state.hard.count), float(state.hard.margin)) == (3, 0.0)


def test_the_hard_counter_is_shared_by_joints_and_arms_within_a_cycle():
    commands = [[2501, 2501, 2001, 3001, 3001, 3801, 0], [2501, 2501, 2001, 3001, 3001, 3801, 0]]
    _, checked, tripped = run(commands, policy=2)
    assert tripped
    assert checked == [commands[0], [*commands[1][:5], 0, 0]]
