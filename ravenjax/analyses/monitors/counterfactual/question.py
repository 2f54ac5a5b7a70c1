"""What a counterfactual is asked: how many false alarms, how early, how sure."""

from __future__ import annotations

import math
from typing import NamedTuple

from ravenjax.errors import UserError, shown

MARGINS = (1.0, 1.1, 1.25, 1.5, 2.0, 3.0, 5.0, 8.0)
"""Times the scales at which candidates alarm; each is a threshold of every candidate's detector."""
PROPOSED = MARGINS.index(1.25)
"""Place of the margin at which a set is selected, before its own is calibrated."""
CONSECUTIVE = (1, 4)
"""Milliseconds in a row above the threshold that make an alarm; each makes a candidate of a
score.
"""
CONFIDENCE = 0.95


class Question(NamedTuple):
    """What is asked."""

    false_alarms_per_hour: float = 4.0  # of the whole set, at most
    lead_ms: int = 10  # a fault is covered by an alarm at least so long before harm
    hours: float = 2.0  # of fault-free motion, in all shares
    most: int = 8  # checks in the set
    groups: tuple[str, ...] = ()  # whose faults are to be covered; (): of all
    seed: int = 0  # of the halves, and of sets at random

    def require(self) -> None:
        """UserError for what cannot be asked."""
        for name, value, low in (
            ("--false-alarms-per-hour", self.false_alarms_per_hour, 0.0),
            ("--hours", self.hours, 0.0),
        ):
            if not (isinstance(value, int | float) and math.isfinite(value) and value > low):
                raise UserError(
                    f"{name} is {shown(value)}, expected a number above {low:g}, such as 2"
                )
        for name, value, low in (
            ("--lead-ms", self.lead_ms, 0),
            ("--most", self.most, 1),
            ("--seed", self.seed, 0),
        ):
            if isinstance(value, bool) or not isinstance(value, int) or value < low:
                raise UserError(f"{name} is {shown(value)}, expected a whole number from {low} on")
