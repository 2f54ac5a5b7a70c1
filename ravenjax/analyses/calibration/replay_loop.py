"""A logged robot's replay as a `ravenjax.engines.interface.Loop`, so that every engine runs many of
them side by side.

The motion's seven columns are the desired joints, a row a cycle; the series that goes out of a
cycle are the joints that the motors then show.
"""

from __future__ import annotations

import dataclasses
from typing import Any

from ravenjax.analyses.calibration import position_loop
from ravenjax.analyses.calibration.position_loop import (
    JOINTS,
    RAVEN2,
    Controller,
    LoopParams,
    LoopState,
)
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.vec import Scalar, Vec, record, replace
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.plant import robot
from ravenjax.robots.raven2.setup import RavenSetup


@dataclasses.dataclass(frozen=True)
class ReplaySetup(RavenSetup):
    """What picks the code of a replay of one arm."""

    controller: Controller = RAVEN2
    shifted: bool = False  # whether the log's desired joints may be late
    whole: bool = (
        True  # encoders and DAC count in whole numbers; without, a replay has a derivative
    )


@record
class ReplayParams:
    """Of one replay."""

    loop: LoopParams
    first: Vec  # joints where the log begins, rad and m


def init(setup: ReplaySetup, params: ReplayParams) -> LoopState:
    """At rest at the joints first measured, brakes off."""
    (arm,) = setup.arms
    plant = robot.init(setup, arm, params.loop.plant, params.first)
    plant = replace(plant, brakes=replace(plant.brakes, engaged=jnp.int32(0)))
    return position_loop.start(setup, arm, setup.controller, plant, whole=setup.whole)


def advance(
    setup: ReplaySetup,
    params: ReplayParams,
    faults: Any,
    state: LoopState,
    now: Scalar,
    motion: tuple[Any, ...],
    golden: Any,
) -> tuple[LoopState, tuple[Scalar, ...], tuple[()]]:
    """One cycle; see `ravenjax.engines.interface.Loop`. There are no faults and no golden run."""
    (arm,), (tool,) = setup.arms, setup.tools
    row = Vec(column[now] for column in motion)
    if setup.shifted:
        before = Vec(column[jnp.maximum(now - 1, 0)] for column in motion)
        row = row - (row - before) * params.loop.setpoint_delay

    def desired(insertion: Scalar) -> Vec:
        return transmission.motor_from_joint(arm, tool, row, insertion, setup.software)

    state, _, _ = position_loop.cycle(
        setup, arm, setup.controller, params.loop, state, desired, whole=setup.whole
    )
    motors = position_loop.readings(setup, arm, state.plant, setup.whole)
    joints = transmission.joint_from_motor(arm, tool, motors, setup.software)
    return state, tuple(joints), ()


def series_length(setup: ReplaySetup) -> int:
    """Joints that go out of a cycle."""
    return JOINTS


def outcomes(setup: ReplaySetup, params: ReplayParams, state: LoopState) -> dict[str, Any]:
    """None but that it has run."""
    return {"ticks": state.plant.tick}
