"""Computes the output pins to the PLC, with the watchdog's wave (raven2: update_atmel_io.cpp)."""

from ravenjax.numbers import Scalar, as_int, jnp
from ravenjax.robots.raven2.run_levels import PIN_FP, PIN_READY, PIN_WATCHDOG

HIGH_CYCLES, PERIOD_CYCLES = 25, 50
"""Length of the wave's high phase and of its period; the first high phase is one cycle longer."""


def step(
    counter: Scalar, soft_estopped: Scalar, runlevel: Scalar, surgeon_mode: Scalar, initialized
) -> tuple[Scalar, Scalar]:
    """Return the counter after one cycle, and the output byte to the PLC (int32).
    counter: int32, cycles since the wave's period began. All other arguments: int32.
    """
    off = soft_estopped != 0
    # While the soft E-stop is on, the counter runs on and the pin stays low.
    restart = ~off & (counter >= PERIOD_CYCLES)
    high = ~off & (counter <= HIGH_CYCLES)
    pedal = (runlevel > 1) & (surgeon_mode != 0)
    pins = (runlevel & 3) | (as_int(pedal) << PIN_FP) | (initialized << PIN_READY)
    pins = pins | (as_int(high) << PIN_WATCHDOG)
    return jnp.where(restart, 0, counter) + 1, pins
