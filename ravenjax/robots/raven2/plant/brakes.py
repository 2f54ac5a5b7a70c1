"""Power-off brakes on the three positioning motors. A documented assumption: no source gives their
data.

The robot has brakes on the RE40 motors only; tool motors run free when unpowered. A brake engages
and releases some time after the PLC's command and then adds dry friction of its holding torque to
the motor: it slips above that.
"""

from __future__ import annotations

from typing import Annotated

from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.quantity import HOUR_MS, Quantity
from ravenjax.numbers.vec import Scalar, as_int, record
from ravenjax.robots.raven2.setup import RavenSetup


@record
class BrakeParams:
    holding_torque: Annotated[  # assumption: maxon AB 28, 0.4 N m at the shaft, times 12.25
        Scalar, Quantity("N m", 0, 1e4, "dry friction of a closed brake, after the gearbox")
    ]
    engage_ticks: Annotated[  # int32; assumption: 15 (relay and spring)
        Scalar, Quantity("ms", 0, HOUR_MS, "from brake command to grip", whole=True)
    ]
    release_ticks: Annotated[  # int32; assumption: 20 (coil current rises)
        Scalar, Quantity("ms", 0, HOUR_MS, "from brake command to free", whole=True)
    ]


@record
class BrakeState:
    engaged: Scalar  # 1: gripping, int32
    pending_ticks: Scalar  # ms for which the command has differed from that, int32


def params(setup: RavenSetup) -> BrakeParams:
    """The assumptions above."""
    return BrakeParams(holding_torque=0.4 * 12.25, engage_ticks=15, release_ticks=20)


def init(setup: RavenSetup, params: BrakeParams, engaged: int = 1) -> BrakeState:
    """At rest, engaged unless said otherwise."""
    return BrakeState(engaged=jnp.int32(engaged), pending_ticks=jnp.int32(0))


def step(
    setup: RavenSetup, params: BrakeParams, state: BrakeState, commanded: Scalar
) -> tuple[BrakeState, Scalar]:
    """One tick with the PLC's command (1: on). Out: dry friction that the brakes add to motors
    1-3 (N m).
    """
    commanded = as_int(commanded)
    pending = jnp.where(commanded != state.engaged, state.pending_ticks + 1, 0)
    delay = jnp.where(commanded != 0, params.engage_ticks, params.release_ticks)
    moves = pending > delay
    engaged = jnp.where(moves, commanded, state.engaged)
    state = BrakeState(engaged=as_int(engaged), pending_ticks=as_int(jnp.where(moves, 0, pending)))
    return state, jnp.where(engaged != 0, params.holding_torque, 0.0)
