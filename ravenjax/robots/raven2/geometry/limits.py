"""Home pose, soft joint limits and hard stops of the control software, as Python numbers.

Source: raven2 `include/raven/defines.h`, `tools.cpp`, `init.cpp`; the 2015 fork where stated. The
original stores joint limits as float32. Callers that need its bits must round the limits.
"""

import math
from typing import NamedTuple

from ravenjax.numbers import Vec
from ravenjax.robots.raven2.geometry.tools import find_tool

_DEG = math.pi / 180.0

HOME_JPOS = Vec((30 * _DEG, 90 * _DEG, 0.4, 0.0, 0.0, 45 * _DEG, 45 * _DEG))  # rad and m

# rad, hard-coded in the 2015 fork for every tool
FORK_ROLL_LIMIT = 150 * _DEG


class SoftLimits(NamedTuple):
    """Limits to which joint targets are clamped: `lower` and `upper`; None for no limit. Order:
    shoulder, elbow (rad), insertion (m), tool_roll, wrist, jaw yaw (rad). Jaws have none.
    """

    lower: tuple[float, float, float, float, float, float | None]
    upper: tuple[float, float, float, float, float, float | None]


POSITIONING_LOWER = (0.0, 45 * _DEG, 0.23)  # rad, rad, m
POSITIONING_UPPER = (90 * _DEG, 135 * _DEG, 0.56)  # rad, rad, m


def soft_limits(tool: str, software: str = "raven2") -> SoftLimits:
    """Return the limits for `tool`. The original applies the limits of the gold arm to both arms.
    The jaw yaw has only a lower limit, from the range of grasp1. The 2015 fork has no limit of the
    yaw, and the same limit of the roll for every tool.
    """
    is_fork = software == "fork2015"
    roll, wrist, grasp1, _ = (limit * _DEG for limit in find_tool(tool).limit_deg)
    if is_fork:
        roll = FORK_ROLL_LIMIT
    lower = *POSITIONING_LOWER, -roll, -wrist, None if is_fork else -grasp1
    return SoftLimits(lower, (*POSITIONING_UPPER, roll, wrist, None))
