"""Phases of an operation with a Raven-II, by which faults can be timed: as planned, not as a
fault leaves them.
"""

from __future__ import annotations

PEDAL_DOWN, PEDAL_UP, FAST, SLOW, IN_TISSUE = "pedal_down", "pedal_up", "fast", "slow", "in_tissue"

PHASES = {
    PEDAL_DOWN: "the robot is in pedal-down, without a stop",
    PEDAL_UP: (
        "it is not: before the operation begins, and while the operator repositions the hands"
    ),
    FAST: (
        "pedal-down, and the faster tip moves faster than in half of the milliseconds of pedal-down"
    ),
    SLOW: "the other half of pedal-down, rests included",
    IN_TISSUE: "a tip is where the operator has it below the surface of the tissue",
}
"""Each with when it is."""
