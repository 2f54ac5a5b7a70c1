"""Waiting for what another process or thread does: as long as it takes on a busy machine, and no
longer.
"""

import time
from collections.abc import Callable
from typing import TypeVar

T = TypeVar("T")
DEADLINE_S = 300.0
"""So late that only what never comes is missed, not what a machine does that has other work."""
DEADLINE_MS = 1000.0 * DEADLINE_S


def until(
    condition: Callable[[], T], told: str = "it never came to that", every_s: float = 0.01
) -> T:
    """The first true answer of `condition`, asked again and again; AssertionError, with what is
    told, if none comes.
    """
    end = time.monotonic() + DEADLINE_S
    while not (answer := condition()):
        assert time.monotonic() < end, told
        time.sleep(every_s)
    return answer
