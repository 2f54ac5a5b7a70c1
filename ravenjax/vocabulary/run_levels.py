"""Run levels of the robot. raven2: defines.h."""

from __future__ import annotations

E_STOP, INIT, PEDAL_UP, PEDAL_DOWN = 0, 1, 2, 3

NAMES = ("E-stop", "init", "pedal up", "pedal down")
"""By number."""


def name(level: int) -> str:
    """A run level in words; of a number that is none, the number."""
    return NAMES[level] if 0 <= level < len(NAMES) else str(level)
