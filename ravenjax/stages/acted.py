"""Adds an action at a given tick to a run, for any fault and any action.

This module is a `Loop` of `ravenjax.engines.interface`: a robot's loop with an additional fault
slot. This last slot holds an action instead of a fault: `code` is its number, `start` the tick in
which it is taken, and `duration` the tick of the fault's first effect. Until `start`, the run
equals the run without the action, bit by bit.

The robot's loop also has

    ACTIONS: names of the actions, by number from 1
    last_command(state) -> the command that action `hold` repeats
    act(params, state, now, takes, begins, good) -> parameters and state of this tick; takes:
        {action: bool, whether it has been taken}; begins: bool, in this tick; good: the last
        command from before the fault's first effect
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

    tick: Any  # of the robot's loop
    good: Any


def add_action(program: Any) -> tuple[Any, dict[str, int]]:
    """Return a program of the same runs with a slot for an action, and the number of each action.

    program: a `ravenjax.engines.interface.TickProgram`.
    """
    injection = program.setup.injection
    injection = dataclasses.replace(injection, slots=injection.slots + 1)
    setup = dataclasses.replace(program.setup, injection=injection, inner=program.module)
    numbers = {name: number for number, name in enumerate(program.loop.ACTIONS, start=1)}
    return dataclasses.replace(program, module=__name__, setup=setup), numbers


def init(setup: Setup, params: Any) -> ActedState:
    """Return the state of the robot's loop."""
    run = inner_loop(setup)
    state = run.init(_without_action(setup), params)
    return ActedState(state, run.last_command(state))


def advance(
    setup: Setup, params: Any, faults: fault.Faults, state: ActedState, now: Scalar, *inputs: Any
) -> tuple[ActedState, tuple[Scalar, ...], Any]:
    """Compute one tick as the robot's loop, with the action."""
    run, (*struck, action) = inner_loop(setup), faults.slots
    good = where(now <= action.duration, run.last_command(state.tick), state.good)
    takes = {
        name: (action.code == number) & (now >= action.start)
        for number, name in enumerate(run.ACTIONS, start=1)
    }
    params, tick = run.act(params, state.tick, now, takes, now == action.start, good)
    tick, series, signals = run.advance(
        _without_action(setup), params, fault.Faults(tuple(struck)), tick, now, *inputs
    )
    return ActedState(tick, good), series, signals


def series_length(setup: Setup) -> int:
    """Return the length of the series."""
    return inner_loop(setup).series_length(setup)


def outcomes(setup: Setup, params: Any, state: ActedState) -> dict[str, Scalar]:
    """Return the outcomes of the robot's loop."""
    return inner_loop(setup).outcomes(_without_action(setup), params, state.tick)


def _without_action(setup: Setup) -> Setup:
    return replace(setup, injection=replace(setup.injection, slots=setup.injection.slots - 1))
