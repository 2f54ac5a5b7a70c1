"""Adds an action at a given tick to a run, for any fault and any action.

This module is a `Loop` of `ravenjax.engines.interface`: the loop of `run` with an additional fault
slot. This last slot holds an action instead of a fault: `code` is its number from 1 in `ACTIONS`,
`start` the tick in which it is taken, and `duration` the tick of the fault's first effect. Until
`start`, the run equals the run without the action, bit by bit.

- `pedal`: the operator lifts the foot, as `console.reaction` does at a cue. The pedal stays up.
- `estop`: the PLC goes to E-stop and cannot be started again, as while the button is pressed.
- `stop`: the overdrive check trips in this tick, whatever the command is.
- `hold`: while the PLC is in pedal-down, the motors get the command that the boards held before the
  fault's first effect.
"""

from typing import Any

from ravenjax.faults import fault
from ravenjax.numbers import Scalar, Vec, for_each_arm, jnp, record, replace
from ravenjax.numbers.vec import where
from ravenjax.robots.raven2.loop import run
from ravenjax.robots.raven2.loop.records import TickParams, TickSignals, TickState
from ravenjax.robots.raven2.loop.run import series_length
from ravenjax.robots.raven2.run_levels import PEDAL_DOWN
from ravenjax.robots.raven2.setup import PerArm, RavenSetup
from ravenjax.vocabulary.reactions import RELEASE

__all__ = ["ACTIONS", "advance", "init", "outcomes", "series_length"]

ACTIONS = ("pedal", "estop", "stop", "hold")
"""Names of the actions, by number from 1."""


@record
class ActedState:
    """A run's state, and the command that action `hold` keeps."""

    tick: TickState
    good: PerArm[Vec]  # int32 counts, on the boards before the fault's first effect


def init(setup: RavenSetup, params: TickParams) -> ActedState:
    """Return the state of `run.init`."""
    return ActedState(
        run.init(_without_action(setup), params), for_each_arm(setup, Vec.full(7, jnp.int32(0)))
    )


def advance(
    setup: RavenSetup,
    params: TickParams,
    faults: fault.Faults,
    state: ActedState,
    now: Scalar,
    *inputs: Any,
) -> tuple[ActedState, tuple[Scalar, ...], TickSignals]:
    """Compute one tick as `run.advance` does, with the action of the last fault slot.

    Arguments and results are those of `ravenjax.engines.interface.Loop`.
    """
    *fault_slots, action = faults.slots
    tick, reaction_params = state.tick, params.reaction
    assert reaction_params is not None

    def is_active(name: str) -> Scalar:
        return (action.code == ACTIONS.index(name) + 1) & (now >= action.start)

    pedal_lifted, held = is_active("pedal"), is_active("hold") & (tick.plc.runlevel == PEDAL_DOWN)
    reaction_state = tick.stages["reaction"]
    felt = jnp.where(pedal_lifted & (reaction_state.felt < 0), now, reaction_state.felt)
    good = where(now <= action.duration, tick.boards.current_cmd, state.good)
    latest, *older = tick.commands
    tick = replace(
        tick,
        commands=(where(held, good, latest), *older),
        stages={**tick.stages, "reaction": replace(reaction_state, felt=felt)},
    )
    overdrive, watchdog = params.control.overdrive, params.plc.watchdog_ticks
    tripped = is_active("stop") & (now == action.start)
    limit = jnp.where(tripped, -1, overdrive.max_inst_dac)
    params = replace(
        params,
        reaction=replace(
            reaction_params,
            action=jnp.where(pedal_lifted, RELEASE, reaction_params.action),
            delay_ms=jnp.where(pedal_lifted, 0.0, reaction_params.delay_ms),
        ),
        control=replace(params.control, overdrive=replace(overdrive, max_inst_dac=limit)),
        plc=replace(params.plc, watchdog_ticks=jnp.where(is_active("estop"), -1, watchdog)),
        usb=replace(params.usb, command_delay=jnp.where(held, 1, params.usb.command_delay)),
    )
    tick, series, signals = run.advance(
        _without_action(setup), params, fault.Faults(tuple(fault_slots)), tick, now, *inputs
    )
    return ActedState(tick, good), series, signals


def outcomes(setup: RavenSetup, params: TickParams, state: ActedState) -> dict[str, Scalar]:
    """Return the outcomes of `run.outcomes`."""
    return run.outcomes(_without_action(setup), params, state.tick)


def _without_action(setup: RavenSetup) -> RavenSetup:
    return replace(setup, injection=replace(setup.injection, slots=setup.injection.slots - 1))
