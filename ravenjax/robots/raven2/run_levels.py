"""Defines the robot's run levels, and the bits of its byte to the PLC (raven2: defines.h)."""

E_STOP, INIT, PEDAL_UP, PEDAL_DOWN = 0, 1, 2, 3

NAMES = ("E-stop", "init", "pedal up", "pedal down")
"""Names of the run levels, by number."""

PIN_FP, PIN_READY, PIN_WATCHDOG = 2, 3, 4
"""Bit numbers in the output byte, after the two bits of the run level."""
