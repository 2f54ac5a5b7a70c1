"""Instruments: their adapter style, coupling and ranges.

Source: raven2 `src/raven/tools.cpp`, `include/raven/tools.h`; the two `r_grasper_A`, `r_grasper_B`
from the 2015 simulator fork (CSLDepend raven2_sim, branch test_sim, same files). Shaft and wrist
lengths of that table are left out because neither kinematics nor control use them. The monopolar
cautery has no ranges there and cannot be driven.
"""

from __future__ import annotations

import dataclasses
import math
from typing import Literal

from ravenjax.errors import UserError, unknown
from ravenjax.numbers.vec import Vec

Style = Literal["raven", "dv", "square_raven"]


@dataclasses.dataclass(frozen=True)
class Tool:
    """One instrument. Ranges are symmetric but for `roll_min_deg`."""

    name: str
    style: Style  # adapter, which decides the signs of coupling, torque and encoders
    wrist_coupling: float  # rad/rad, how far each jaw turns with the wrist
    roll_max_deg: float  # deg, hard stop that homing looks for
    roll_limit_deg: float  # deg, soft limit
    wrist_max_deg: float  # deg
    wrist_limit_deg: float  # deg
    grasp1_max_deg: float  # deg
    grasp1_limit_deg: float  # deg
    grasp2_max_deg: float  # deg
    grasp2_limit_deg: float  # deg
    roll_min_deg: float | None = None  # deg, hard stop on the other side; -roll_max_deg if None

    @property
    def hard_max(self) -> Vec:
        """Hard stops of tool_roll, wrist, grasp1, grasp2 on the positive side, rad."""
        return Vec(
            map(
                math.radians,
                (self.roll_max_deg, self.wrist_max_deg, self.grasp1_max_deg, self.grasp2_max_deg),
            )
        )

    @property
    def hard_min(self) -> Vec:
        """Hard stops of tool_roll, wrist, grasp1, grasp2 on the negative side, rad."""
        roll = -self.roll_max_deg if self.roll_min_deg is None else self.roll_min_deg
        return (-self.hard_max).replace(0, math.radians(roll))


TOOLS = {
    tool.name: tool
    for tool in (
        Tool("r_grasper", "raven", 0.0, 330, 182, 100, 70, 120, 105, 120, 105),
        Tool("r_sq_grasper", "square_raven", 0.0, 330, 182, 115, 75, 135, 85, 135, 85),
        Tool("large_needle", "dv", 0.5, 275, 220, 95, 75, 115, 85, 115, 85),
        Tool("micro_forceps", "dv", 0.5, 275, 182, 85, 75, 150, 85, 150, 85),
        Tool("bipolar_forceps", "dv", 0.64, 260, 182, 70, 65, 140, 85, 140, 85),
        Tool("cardiere_forceps", "dv", 0.7, 260, 182, 90, 85, 100, 85, 100, 85),
        Tool("mopocu_scissor", "dv", 0.5, 260, 250, 90, 75, 100, 85, 105, 95),
        Tool("potts_scissor", "dv", 0.5, 260, 220, 85, 75, 130, 110, 130, 110),
        Tool("r_grasper_A", "raven", 0.0, 290, 182, 115, 75, 120, 85, 120, 85, roll_min_deg=-330),
        Tool("r_grasper_B", "raven", 0.0, 325, 182, 115, 75, 120, 85, 120, 85),
    )
}

DEFAULT_TOOLS = {
    "raven2": {"gold": "r_grasper", "green": "r_grasper"},
    "fork2015": {"gold": "r_grasper_B", "green": "r_grasper_A"},
}


def find_tool(name: str) -> Tool:
    """The tool of that name, or a UserError that lists the names."""
    if not isinstance(name, str) or name not in TOOLS:
        raise UserError(unknown("tool", name, TOOLS))
    return TOOLS[name]
