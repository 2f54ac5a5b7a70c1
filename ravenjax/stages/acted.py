"""Adds an action at a given tick to a run, for any fault and any action.

This module is a `Loop` of `ravenjax.engines.interface`: a robot's loop with an additional fault
slot. The last slot holds an action. Its fields differ from those of a fault: `code` is the number
of the action, `start` the tick in which the action is taken, and `duration` the tick of the fault's
first effect. Until `start`, the run equals the run without the action, bit by bit.

The robot's loop also has

    ACTIONS: names of the actions, by number from 1
    last_command(state) -> the command that action `hold` repeats
    act(params, state, now, is_taken, begins, good_command) -> parameters and state of this tick;
        is_taken: {action: bool, it has been taken}; begins: bool, it is taken in exactly this tick;
        good_command: the last command from before the fault's first effect
"""

import dataclasses
from typing import Any

from ravenjax.faults import fault
from ravenjax.numbers import Scalar, Setup, record, replace
from ravenjax.numbers.setup import inner_loop
from ravenjax.numbers.vec import where


@record
class ActedState:
    """A run's state, and the command that an action may hold."""

    tick: Any  # state of the robot's loop
    good_command: Any  # last command from before the fault's first effect


def add_action(program: Any) -> tuple[Any, dict[str, int]]:
    """Return a program of the same runs with a slot for an action, and the number of each action.
    program: a `ravenjax.engines.interface.TickProgram`.
    """
    injection = program.setup.injection
    injection = dataclasses.replace(injection, slots=injection.slots + 1)
    # The program runs the loop of this module, which calls the robot's loop, the inner module.
    setup = dataclasses.replace(program.setup, injection=injection, inner=program.module)
    numbers = {name: number for number, name in enumerate(program.loop.ACTIONS, start=1)}
    return dataclasses.replace(program, module=__name__, setup=setup), numbers


def init(setup: Setup, params: Any) -> ActedState:
    """Return the state before the first tick."""
    loop = inner_loop(setup)
    state = loop.init(_without_action(setup), params)
    return ActedState(state, loop.last_command(state))


def advance(
    setup: Setup, params: Any, faults: fault.Faults, state: ActedState, now: Scalar, *inputs: Any
) -> tuple[ActedState, tuple[Scalar, ...], Any]:
    """Compute the tick `now` of the robot's loop, with the action in the last slot of `faults`.

    Return the state, the series and the signals, as the robot's loop does.
    """
    loop = inner_loop(setup)
    *fault_slots, action = faults.slots
    # The field `duration` of an action holds the tick of the fault's first effect. Up to then, keep
    # the robot's last command, which the action may hold.
    is_before_effect = now <= action.duration
    good_command = where(is_before_effect, loop.last_command(state.tick), state.good_command)
    is_taken = {
        name: (action.code == number) & (now >= action.start)
        for number, name in enumerate(loop.ACTIONS, start=1)
    }
    params, tick = loop.act(params, state.tick, now, is_taken, now == action.start, good_command)
    robot_faults = fault.Faults(tuple(fault_slots))
    tick, series, signals = loop.advance(
        _without_action(setup), params, robot_faults, tick, now, *inputs
    )
    return ActedState(tick, good_command), series, signals


def series_length(setup: Setup) -> int:
    """Return how many numbers of a golden run are stored in each tick."""
    return inner_loop(setup).series_length(setup)


def outcomes(setup: Setup, params: Any, state: ActedState) -> dict[str, Scalar]:
    """Return the outcomes of the robot's loop."""
    return inner_loop(setup).outcomes(_without_action(setup), params, state.tick)


def _without_action(setup: Setup) -> Setup:
    return replace(setup, injection=replace(setup.injection, slots=setup.injection.slots - 1))
