"""Round steps of the report's bins."""

from __future__ import annotations

import math


def round_step(width: float) -> float:
    """The nearest of 1, 2, 2.5, 5 times a power of ten, so that bin edges are round numbers; 1
    for 0.
    """
    if width <= 0:
        return 1.0
    power = 10.0 ** math.floor(math.log10(width))
    return min(
        (m * power for m in (1, 2, 2.5, 5, 10)), key=lambda step: abs(math.log(step / width))
    )
