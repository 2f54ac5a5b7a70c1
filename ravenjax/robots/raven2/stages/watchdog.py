"""Output pins to the PLC, with the watchdog's square wave (raven2: update_atmel_io.cpp)."""

import numpy as np

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, as_int, record
from ravenjax.robots.raven2.setup import RavenSetup

HIGH_CYCLES, PERIOD_CYCLES = 25, 50
FP, READY, WD = 2, 3, 4
"""Bit numbers in the output byte, after the two bits of the run level; raven2: defines.h."""


@record
class WatchdogState:
    counter: Scalar  # int32 cycles; also counts while the wave is off


def init(setup: RavenSetup) -> WatchdogState:
    """Return the state at the start of a high phase (its first one is 26 cycles long)."""
    return WatchdogState(np.int32(0))


def step(
    state: WatchdogState,
    soft_estopped: Scalar,
    runlevel: Scalar,
    surgeon_mode: Scalar,
    initialized: Scalar,
) -> tuple[WatchdogState, Scalar]:
    """Compute one cycle. Return the state and the output byte (int32)."""
    silent = soft_estopped != 0
    restart = ~silent & (state.counter >= PERIOD_CYCLES)
    high = ~silent & (state.counter <= HIGH_CYCLES)
    pedal = (runlevel > 1) & (surgeon_mode != 0)
    pins = (runlevel & 3) | (as_int(pedal) << FP) | (initialized << READY) | (as_int(high) << WD)
    return WatchdogState(jnp.where(restart, 0, state.counter) + 1), pins
