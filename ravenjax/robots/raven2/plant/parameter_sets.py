"""Every set of mechanical parameters that a campaign can choose by name, of seven joints each.

The authors' sets give joints 1-3 and share documented values for the tool (`published`);
`power_consistent` is a robot of its own (`power_consistent`).
"""

from __future__ import annotations

import dataclasses
from typing import Literal

from ravenjax.robots.raven2.geometry.transmission import GP42
from ravenjax.robots.raven2.plant import cables, power_consistent, published

Name = Literal["power_consistent", "traj3", "A", "B", "C", "D", "E", "matlab_main", "matlab_global"]

DEFAULT: Name = "power_consistent"
"""What a campaign's robot is made of unless it says otherwise."""

UNLIMITED = 1e6
"""N m; no motor comes near. N; nor does a cable."""


@dataclasses.dataclass(frozen=True)
class ParameterSet:
    """Seven motors with their cables and joints; units as in `robot.PlantParams`."""

    torque_per_count: tuple[float, ...]
    gain: tuple[float, ...]
    bias: tuple[float, ...]
    motor_inertia: tuple[float, ...]
    motor_coulomb: tuple[float, ...]
    motor_viscous: tuple[float, ...]
    reaction_scale: tuple[float, ...]
    torque_limit: tuple[float, ...]
    stall_torque: tuple[float, ...]
    back_emf: tuple[float, ...]
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    strength: tuple[float, ...]
    link_coulomb: tuple[float, ...]
    link_viscous: tuple[float, ...]


def parameter_set(name: str) -> ParameterSet:
    """The set of that name, or a UserError that lists the names."""
    if name == "power_consistent":
        return POWER_CONSISTENT
    values = published.parameter_set(name, others=("power_consistent",))
    return ParameterSet(
        torque_per_count=_seven((values.torque_per_count,) * 3, published.TOOL_TORQUE_PER_COUNT),
        gain=_seven(values.gain, 1.0),
        bias=_seven(values.bias, 0.0),
        motor_inertia=_seven((published.MOTOR_INERTIA,) * 3, published.TOOL_MOTOR_INERTIA),
        motor_coulomb=_seven(values.motor_coulomb, published.TOOL_MOTOR_COULOMB),
        motor_viscous=_seven(values.motor_viscous, published.TOOL_MOTOR_VISCOUS),
        reaction_scale=_seven((1.0, 1.0, 1.0), published.TOOL_GEARBOX),
        torque_limit=(UNLIMITED,) * 7,
        stall_torque=(UNLIMITED,) * 7,
        back_emf=(0.0,) * 7,
        stiffness=_seven(values.stiffness, published.TOOL_CABLE_STIFFNESS),
        damping=_seven(values.damping, published.TOOL_CABLE_DAMPING),
        strength=(UNLIMITED,) * 7,
        link_coulomb=_seven(values.link_coulomb, published.TOOL_LINK_COULOMB),
        link_viscous=_seven(values.link_viscous, published.TOOL_LINK_VISCOUS),
    )


def nominal(name: str) -> str:
    """The set from which the nominal model of a robot with set `name` has its gains and friction.

    The authors' sets differ as robots of one kind do, and share one model.
    """
    return name if name == "power_consistent" else "traj3"


def tells_tension(name: str) -> bool:
    """Whether the cables of the set of that name carry what statics allow, so that a strength in N
    can be exceeded.

    With the authors' law a motor pulls twelve times as hard at its cable as it can.
    """
    return name == "power_consistent"


def _seven(positioning: tuple[float, ...], tool: float) -> tuple[float, ...]:
    return (*positioning, tool, tool, tool, tool)


POWER_CONSISTENT = ParameterSet(
    torque_per_count=_seven(
        (published.CONTROLLER_TORQUE_PER_COUNT,) * 3, published.TOOL_TORQUE_PER_COUNT
    ),
    gain=(1.0,) * 7,
    bias=power_consistent.BIAS,
    motor_inertia=_seven((power_consistent.MOTOR_INERTIA,) * 3, published.TOOL_MOTOR_INERTIA),
    motor_coulomb=power_consistent.MOTOR_COULOMB,
    motor_viscous=power_consistent.MOTOR_VISCOUS,
    reaction_scale=_seven((GP42,) * 3, published.TOOL_GEARBOX),
    torque_limit=_seven(
        (power_consistent.RE40_TORQUE_LIMIT,) * 3, power_consistent.RE30_TORQUE_LIMIT
    ),
    stall_torque=_seven(
        (power_consistent.RE40_STALL_TORQUE,) * 3, power_consistent.RE30_STALL_TORQUE
    ),
    back_emf=_seven((power_consistent.RE40_BACK_EMF,) * 3, power_consistent.RE30_BACK_EMF),
    stiffness=_seven(published.parameter_set("traj3").stiffness, published.TOOL_CABLE_STIFFNESS),
    damping=_seven(published.parameter_set("traj3").damping, published.TOOL_CABLE_DAMPING),
    strength=_seven((cables.POSITIONING_STRENGTH,) * 3, cables.TOOL_STRENGTH),
    link_coulomb=power_consistent.LINK_COULOMB,
    link_viscous=power_consistent.LINK_VISCOUS,
)
