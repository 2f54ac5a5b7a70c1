"""Run levels, sublevels and the soft E-stop flag."""

from __future__ import annotations

import numpy as np

from ravenjax.numbers.vec import replace
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import state_machine as machine

RAVEN2, FORK = RavenSetup(), RavenSetup(software="fork2015", tools=("r_grasper_B",))


def follow(levels, state):
    shown = []
    for tick, level in enumerate(levels):
        state = machine.adopt(state, np.int32(tick), np.int32(level))
        shown.append(int(state.runlevel))
    return state, shown


def test_the_fourth_mismatching_cycle_is_believed_matching_ones_do_not_reset():
    _, shown = follow([1, 0, 1, 0, 0, 1, 0, 1, 1], machine.init(RAVEN2, 0))
    assert shown == [0] * 7 + [1] * 2


def test_entering_e_stop_clears_the_flags():
    state = replace(machine.init(RAVEN2, 3), soft_estopped=np.int32(1))
    state, _ = follow([0] * 4, state)
    assert (int(state.soft_estopped), int(state.initialized), int(state.sublevel)) == (0, 0, 0)
    assert (int(state.estop.first_tick), int(state.estop.count)) == (3, 1)


def test_the_lowest_board_decides_and_other_bits_do_not():
    params, state = machine.params(RAVEN2), machine.init(RAVEN2, 3)
    pins = (np.int32(0b11_010101), np.int32(0b10_111111))
    assert int(machine.desired_runlevel(params, state, pins)) == 2
    assert int(machine.desired_runlevel(machine.params(FORK), state, pins)) == 3


def test_the_fork_passes_sublevels_0_and_1_in_one_cycle():
    state = replace(machine.init(FORK, 0), runlevel=np.int32(1))
    state, follows = machine.initialise(FORK, state)
    assert (int(state.sublevel), bool(follows)) == (2, True)
    state, follows = machine.initialise(
        RAVEN2, replace(machine.init(RAVEN2, 0), runlevel=np.int32(1))
    )
    assert (int(state.sublevel), bool(follows)) == (1, False)
