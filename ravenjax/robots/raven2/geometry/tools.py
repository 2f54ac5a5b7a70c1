"""Instruments: adapter to the robot, coupling and joint ranges, from models/raven2/tools.toml."""

import dataclasses
import math
import tomllib
from typing import Literal

from ravenjax import resources
from ravenjax.errors import UserError, describe_unknown_name
from ravenjax.numbers import Vec

Style = Literal["raven", "dv", "square_raven"]


@dataclasses.dataclass(frozen=True)
class Tool:
    """One instrument. Its ranges are lists of four numbers: tool_roll, wrist, grasp1, grasp2."""

    name: str
    style: Style  # adapter, which decides the signs of coupling, torque and encoders
    wrist_coupling: float  # rad/rad, turn of each jaw per turn of the wrist
    max_deg: list[float]  # deg, hard stops that homing searches for
    limit_deg: list[float]  # deg, soft limits
    roll_min_deg: float | None = None  # deg, negative hard stop of the roll; None: -max_deg[0]

    @property
    def hard_max(self) -> Vec:
        """Hard stops of tool_roll, wrist, grasp1, grasp2 on the positive side, rad."""
        return Vec(map(math.radians, self.max_deg))

    @property
    def hard_min(self) -> Vec:
        """Hard stops of tool_roll, wrist, grasp1, grasp2 on the negative side, rad."""
        roll_deg = -self.max_deg[0] if self.roll_min_deg is None else self.roll_min_deg
        return (-self.hard_max).replace(0, math.radians(roll_deg))


_TABLES = tomllib.loads(resources.find_model("raven2/tools.toml").read_text(encoding="utf-8"))
TOOLS = {name: Tool(name, **table) for name, table in _TABLES.items()}

DEFAULT_TOOLS = {
    "raven2": {"gold": "r_grasper", "green": "r_grasper"},
    "fork2015": {"gold": "r_grasper_B", "green": "r_grasper_A"},
}


def find_tool(name: str) -> Tool:
    """Return the tool with this name. Raises UserError for another name, and lists all names."""
    if not isinstance(name, str) or name not in TOOLS:
        raise UserError(describe_unknown_name("tool", name, TOOLS))
    return TOOLS[name]
