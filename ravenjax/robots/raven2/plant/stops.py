"""Hard stops of the joints: one-sided stiff springs, implicit like the cables.

Positions are those the control software homes against (raven2: defines.h, homing.cpp, tools.cpp):
shoulder 0 deg, elbow 137.5 deg, insertion 0.562 m, the tool's own angles. The other ends of the
first three joints are not published: the soft limit plus the margin that the published end of elbow
and insertion has. Stiffness is an assumption: metal on rubber, stiffer than the cable that presses
the joint against it.
"""

from __future__ import annotations

import math
from typing import Annotated

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.quantity import Quantity
from ravenjax.numbers.vec import Scalar, Vec, record
from ravenjax.robots.raven2.geometry import limits
from ravenjax.robots.raven2.geometry.tools import find_tool

_MARGIN = (math.radians(2.5), math.radians(2.5), 2e-3)  # rad, rad, m
SETTLING_S = 5e-3  # s, damping over stiffness


@record
class StopParams:
    lower: Annotated[Vec, limits.position("lower hard stop of the joint")]
    upper: Annotated[Vec, limits.position("upper hard stop of the joint")]
    stiffness: Annotated[
        Vec,
        Quantity(
            "N m/rad; insertion N/m",
            0,
            1e8,
            "stiffness of the hard stop; 0: no stop",
            why="a stop pushes back",
        ),
    ]


@record
class Contact:
    """Force on a joint at its present speed, and how much of it a gain of speed takes away."""

    force: Scalar  # N m; insertion N
    damping: Scalar  # N m s/rad; insertion N s/m


def params(tool: str) -> StopParams:
    """Of an arm with that tool."""
    instrument = find_tool(tool)
    low, high = limits.POSITIONING_LOWER, limits.POSITIONING_UPPER
    return StopParams(
        lower=Vec((low[0], low[1] - _MARGIN[1], low[2] - _MARGIN[2], *instrument.hard_min)),
        upper=Vec(
            (high[0] + _MARGIN[0], high[1] + _MARGIN[1], high[2] + _MARGIN[2], *instrument.hard_max)
        ),
        stiffness=Vec((1e5, 1e5, 1e6, 20.0, 20.0, 20.0, 20.0)),
    )


def contact(params: StopParams, i: int, jpos: Scalar, jvel: Scalar, dt: float) -> Contact:
    """Joint `i` at `jpos` (rad, m) and `jvel` over the coming `dt` (s); zero within the range."""
    beyond = jnp.maximum(jpos - params.upper[i], 0.0) + jnp.minimum(jpos - params.lower[i], 0.0)
    damping = jnp.where(beyond != 0.0, params.stiffness[i] * (dt + SETTLING_S), 0.0)
    return Contact(force=-params.stiffness[i] * beyond - damping * jvel, damping=damping)
