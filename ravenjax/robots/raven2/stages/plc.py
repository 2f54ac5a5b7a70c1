"""Simulates the programmable logic controller (PLC) between computer and motor power.

The PLC's program is not published. The PLC reads the start and E-stop buttons, switches the brake
relays, and times the watchdog. The following rules are implied by the control software (raven2:
defines.h, state_machine.cpp, update_atmel_io.cpp), or are *assumed*.

- The PLC writes a run level to its pins PS0 and PS1, bits 6 and 7 of the input byte. The bits are
  read as a number.
- The start button changes E-STOP (0) to INIT (1), while the watchdog's signal is present and the
  E-stop button is not pressed. With `auto_start` the button is pressed automatically, but never
  after a trip.
- INIT changes to PEDAL_UP (2) when the software reports READY. PEDAL_UP changes to PEDAL_DOWN (3)
  while the foot pedal pin is set and the software is ready, and back to PEDAL_UP otherwise.
- Any level changes to E-STOP when the watchdog pin has had no edge for longer than 1.5 of its 50 ms
  periods, or by the E-stop button. After such a trip, a person must press start.
- The PLC reads the output pins of each USB board. It trips if the watchdog of any board is missing.
  The foot pedal and READY count if all boards report them.
- The PLC commands the brakes on in E-STOP and PEDAL_UP. The model of the brakes has their delay.
"""

import operator
from functools import reduce

from ravenjax.numbers import Scalar, as_int, cast_to_real, describe_fields, jnp, record
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import check

# Input byte: the run level is in bits 6 and 7.
PIN_RUNLEVEL = 6

CAUSE_NONE, CAUSE_WATCHDOG, CAUSE_BUTTON = 0, 1, 2


@describe_fields
@record
class PlcParams:
    watchdog_ticks: Scalar = 75  # int32; assumption: 1.5 periods of 50 ms
    auto_start: Scalar = 1  # int32; assumption: 1
    start_ticks: Scalar = 100  # int32; assumption: 100 (two periods)


@record
class PlcState:
    tick: Scalar  # ms since the start, int32
    runlevel: Scalar  # 0..3, int32
    watchdog: tuple[Scalar, ...]  # watchdog pin of each board at the last tick, int32
    quiet_ticks: tuple[Scalar, ...]  # ms since the last edge of each watchdog pin, int32
    alive_ticks: Scalar  # ms in E-STOP in which start may be pressed, int32
    trip_cause: Scalar  # CAUSE_* of the first trip since start was pressed, latched; int32
    watchdog_lost: check.CheckHistory  # trips by the watchdog; margin: ms left, negative: tripped


@record
class PlcSignal:
    output_pins: tuple[Scalar, ...]  # output byte of each board to the PLC, int32
    estop_button: Scalar  # bool, pressed
    start_button: Scalar  # bool, pressed


@record
class PlcOutput:
    runlevel: Scalar  # run level on the pins, int32
    brakes: Scalar  # 1: brakes commanded on, int32


def init(setup: RavenSetup, runlevel: Scalar = run_levels.PEDAL_UP, boards: int = 1) -> PlcState:
    """Return a PLC in `runlevel`: PEDAL_UP for a homed and ready robot, E_STOP at power-on.
    boards: number of boards whose pins may differ; 1 if all boards get the same pins.
    """
    zero = jnp.int32(0)
    return PlcState(
        tick=zero,
        runlevel=jnp.int32(runlevel),
        watchdog=(zero,) * boards,
        quiet_ticks=(zero,) * boards,
        alive_ticks=zero,
        trip_cause=zero,
        watchdog_lost=check.init(setup),
    )


def input_pins(runlevel: Scalar) -> Scalar:
    """Return the byte that the control computer reads from each board, int32."""
    return (runlevel & 3) << PIN_RUNLEVEL


def brakes_commanded(runlevel: Scalar) -> Scalar:
    """Return 1 if the brakes are commanded on at this run level, int32."""
    return as_int((runlevel == run_levels.E_STOP) | (runlevel == run_levels.PEDAL_UP))


def step(
    setup: RavenSetup, params: PlcParams, state: PlcState, signal: PlcSignal
) -> tuple[PlcState, PlcOutput]:
    """Compute one tick: read the software's pins and decide the run level."""
    common_pins = reduce(operator.and_, signal.output_pins)
    pedal = (common_pins >> run_levels.PIN_FP) & 1
    ready = (common_pins >> run_levels.PIN_READY) & 1
    watchdog = tuple((pins >> run_levels.PIN_WATCHDOG) & 1 for pins in signal.output_pins)
    quiet_ticks = tuple(
        jnp.where(pin != pin_before, 0, ticks + 1)
        for pin, pin_before, ticks in zip(watchdog, state.watchdog, state.quiet_ticks, strict=True)
    )
    margin = params.watchdog_ticks - reduce(jnp.maximum, quiet_ticks)
    estop_button = signal.estop_button
    watchdog_lost = margin < 0
    stopped = state.runlevel == run_levels.E_STOP
    may_start = stopped & ~watchdog_lost & ~estop_button
    alive_ticks = jnp.where(may_start, state.alive_ticks + 1, 0)
    untripped = state.trip_cause == CAUSE_NONE
    pressed = signal.start_button & may_start
    start = pressed | (untripped & (params.auto_start != 0) & (alive_ticks > params.start_ticks))
    after_stop = jnp.where(start, run_levels.INIT, run_levels.E_STOP)
    after_init = jnp.where(ready != 0, run_levels.PEDAL_UP, run_levels.INIT)
    in_operation = jnp.where((pedal & ready) != 0, run_levels.PEDAL_DOWN, run_levels.PEDAL_UP)
    powered = jnp.where(state.runlevel == run_levels.INIT, after_init, in_operation)
    trips = watchdog_lost | estop_button
    runlevel = as_int(jnp.where(stopped, after_stop, jnp.where(trips, run_levels.E_STOP, powered)))
    watched = ~stopped & untripped
    tripped_now = watched & trips
    cause = jnp.where(estop_button, CAUSE_BUTTON, CAUSE_WATCHDOG)
    latched = jnp.where(pressed, CAUSE_NONE, state.trip_cause)
    state = PlcState(
        tick=state.tick + 1,
        runlevel=runlevel,
        watchdog=watchdog,
        quiet_ticks=tuple(map(as_int, quiet_ticks)),
        alive_ticks=as_int(alive_ticks),
        trip_cause=as_int(jnp.where(tripped_now, cause, latched)),
        watchdog_lost=check.update_check(
            state.watchdog_lost,
            state.tick,
            tripped_now & ~estop_button,
            jnp.where(watched, cast_to_real(setup, margin), jnp.inf),
        ),
    )
    return state, PlcOutput(runlevel, brakes_commanded(runlevel))
