"""State machine: run level from the PLC's pins, initialisation sublevels, soft E-stop flag.

raven2: state_machine.cpp, init.cpp, rt_process_preempt.cpp. Homing is not simulated: the software
starts as if homing were complete, in cartesian mode. In run level init, the software passes through
the sublevels 0, 1 and 2, and stays in sublevel 3. Sublevel 2 lasts 11 cycles. Sublevel 3 sets the
flag `initialized`. The PLC reads this flag, and then changes the run level to pedal-up. After an
E-stop the robot passes through the same sublevels, as the real robot does in cartesian mode.
"""

from functools import reduce

import numpy as np

from ravenjax.numbers import Scalar, as_int, describe_fields, jnp, record, replace
from ravenjax.robots.raven2.run_levels import E_STOP, INIT
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import check

MISMATCHES = 4
"""Cycles with another level on the pins before the level changes; raven2: state_machine.cpp."""

SETTLING_CYCLES = 11
"""Cycles of sublevel 2; raven2: init.cpp."""


@describe_fields
@record
class StateMachineParams:
    plc_obeyed: Scalar  # int32; 0 in the simulator builds of the 2015 fork


@record
class StateMachineState:
    runlevel: Scalar  # int32
    sublevel: Scalar  # int32
    initialized: Scalar  # int32 flag, the READY pin
    soft_estopped: Scalar  # int32 flag: DACs are 0 and the watchdog is silent
    mismatches: Scalar  # int32 cycles, never reset by matching cycles
    settling: Scalar  # int32 cycles spent in sublevel 2, kept when it is left early
    estop: check.CheckHistory  # trips when run level 0 is entered
    soft_estop: check.CheckHistory  # trips when the soft E-stop is raised


def params(setup: RavenSetup) -> StateMachineParams:
    """Return the parameters. raven2 obeys the PLC; simulator builds of the fork do not."""
    return StateMachineParams(np.int32(setup.software == "raven2"))


def init(setup: RavenSetup, runlevel: int) -> StateMachineState:
    """Return the state of a homed robot at `runlevel`."""
    ready = runlevel > E_STOP
    zero, no_trips = np.int32(0), check.init(setup)
    # Homing ends in sublevel 3.
    level, sublevel = np.int32(runlevel), np.int32(3 if ready else 0)
    initialized, soft_estopped, mismatches, settling = np.int32(ready), zero, zero, zero
    return StateMachineState(
        level, sublevel, initialized, soft_estopped, mismatches, settling, no_trips, no_trips
    )


def desired_runlevel(
    params: StateMachineParams, state: StateMachineState, pins: tuple[Scalar, ...]
) -> Scalar:
    """Return the run level on the input pins: bits 7..6 as a number, the lowest of all boards."""
    lowest = reduce(jnp.minimum, ((byte >> 6) & 3 for byte in pins))
    return jnp.where(params.plc_obeyed != 0, lowest, state.runlevel)


def adopt_level(state: StateMachineState, tick: Scalar, desired: Scalar) -> StateMachineState:
    """Return the state, whose run level becomes `desired` after MISMATCHES cycles that differ."""
    mismatch = desired != state.runlevel
    count = state.mismatches + as_int(mismatch)
    changed = mismatch & (count >= MISMATCHES)
    stopped = changed & (desired == E_STOP)
    running = as_int(~stopped)
    return replace(
        state,
        runlevel=jnp.where(changed, desired, state.runlevel),
        mismatches=jnp.where(changed, 0, count),
        sublevel=state.sublevel * running,
        initialized=state.initialized * running,
        soft_estopped=state.soft_estopped * running,
        estop=check.update_check(state.estop, tick, stopped),
    )


def advance_sublevel(
    setup: RavenSetup, state: StateMachineState
) -> tuple[StateMachineState, Scalar]:
    """Return the state with the next sublevel, and whether desired poses become measured poses."""
    level, sublevel = state.runlevel, state.sublevel
    in_init = level == INIT
    start = in_init & (sublevel == 0)
    prepare = in_init & (sublevel == 1)
    settle = in_init & (sublevel == 2)
    if setup.software == "fork2015":
        # The fork's `switch` falls through from sublevel 0 into 1 in this cycle: `start` is False.
        start, prepare = start & False, prepare | start
    settling = state.settling + as_int(settle)
    settled = settling >= SETTLING_CYCLES
    next_sublevel = jnp.where(
        start, 1, jnp.where(prepare, 2, jnp.where(settle & settled, 3, sublevel))
    )
    ready = jnp.where(
        in_init & (sublevel == 3), 1, jnp.where(level == E_STOP, 0, state.initialized)
    )
    follows_measured = settle | (prepare & (state.initialized == 0))
    settling = jnp.where(settled, 0, settling)
    state = replace(state, sublevel=next_sublevel, initialized=ready, settling=settling)
    return state, follows_measured


def raise_soft_estop(state: StateMachineState, tick: Scalar, tripped: Scalar) -> StateMachineState:
    """Return the state with the soft E-stop flag set if `tripped`. The flag stops the watchdog at
    once, and sets DACs to 0 from the next cycle until run level 0.
    """
    return replace(
        state,
        soft_estopped=state.soft_estopped | as_int(tripped),
        soft_estop=check.update_check(state.soft_estop, tick, tripped),
    )
