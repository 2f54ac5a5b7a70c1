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
    """A run's state, and the command that an action may hold."""

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
    """Compute one tick as `run.advance`, with the action; see `ravenjax.engines.interface.Loop`."""
    *struck, action = faults.slots
    tick, assumed = state.tick, params.reaction
    assert assumed is not None

    def takes(name: str) -> Scalar:
        return (action.code == ACTIONS.index(name) + 1) & (now >= action.start)

    lifts, holds = takes("pedal"), takes("hold") & (tick.plc.runlevel == PEDAL_DOWN)
    reacting = tick.stages["reaction"]
    felt = jnp.where(lifts & (reacting.felt < 0), now, reacting.felt)
    good = where(now <= action.duration, tick.boards.current_cmd, state.good)
    latest, *older = tick.commands
    tick = replace(
        tick,
        commands=(where(holds, good, latest), *older),
        stages={**tick.stages, "reaction": replace(reacting, felt=felt)},
    )
    drive, watchdog = params.control.overdrive, params.plc.watchdog_ticks
    tripped = takes("stop") & (now == action.start)
    limit = jnp.where(tripped, -1, drive.max_inst_dac)
    params = replace(
        params,
        reaction=replace(
            assumed,
            action=jnp.where(lifts, RELEASE, assumed.action),
            delay_ms=jnp.where(lifts, 0.0, assumed.delay_ms),
        ),
        control=replace(params.control, overdrive=replace(drive, max_inst_dac=limit)),
        plc=replace(params.plc, watchdog_ticks=jnp.where(takes("estop"), -1, watchdog)),
        usb=replace(params.usb, command_delay=jnp.where(holds, 1, params.usb.command_delay)),
    )
    tick, series, signals = run.advance(
        _without_action(setup), params, fault.Faults(tuple(struck)), tick, now, *inputs
    )
    return ActedState(tick, good), series, signals


def outcomes(setup: RavenSetup, params: TickParams, state: ActedState) -> dict[str, Scalar]:
    """Return the outcomes of `run.outcomes`."""
    return run.outcomes(_without_action(setup), params, state.tick)


def _without_action(setup: RavenSetup) -> RavenSetup:
    return replace(setup, injection=replace(setup.injection, slots=setup.injection.slots - 1))
