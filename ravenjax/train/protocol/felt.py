"""The force at an operator's hand: that of the cue, and what the instrument touches."""

from __future__ import annotations

import math

from ravenjax.robots.raven2.arms import ArmName
from ravenjax.train.protocol.frame import Frame
from ravenjax.train.protocol.world import Point


def force(frame: Frame, arm: ArmName, units_per_n: float, cap: float, cue: bool) -> Point:
    """Device units along the axes of frame 0; never more than `cap`, or the cue's own where that is
    more.

    cue: whether the cue is felt. The contact's force is felt either way: it is no aid, the tissue
    is there.
    """
    places, numbers = frame.layout.places, frame.numbers
    first, touch = places[f"{arm}/force"].start, places[f"{arm}/contact"].start
    pull = numbers[first : first + 3] if cue else [0.0, 0.0, 0.0]
    x, y, z = (a + units_per_n * b for a, b in zip(pull, numbers[touch : touch + 3], strict=True))
    size, most = math.hypot(x, y, z), max(cap, math.hypot(*pull))
    share = most / size if size > most else 1.0
    return x * share, y * share, z * share
