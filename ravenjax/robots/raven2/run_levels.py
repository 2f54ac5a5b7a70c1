"""Run levels of the robot. raven2: defines.h."""

E_STOP, INIT, PEDAL_UP, PEDAL_DOWN = 0, 1, 2, 3

NAMES = ("E-stop", "init", "pedal up", "pedal down")
"""Names of the run levels, by number."""
