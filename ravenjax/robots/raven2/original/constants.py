"""Defines constants as the control software stores them: its `float`s are rounded to float32.

Sources: raven2 `include/raven/defines.h`, `init.cpp`, `fwd_cable_coupling.cpp`,
`inv_cable_coupling.cpp`, `DS0.h`. The constants are Python numbers, so JAX converts each to the
type of the other operand.
"""

import math
from operator import mul

import numpy as np

from ravenjax import resources
from ravenjax.numbers import Vec
from ravenjax.robots.raven2.geometry import limits, transmission
from ravenjax.robots.raven2.geometry.tools import find_tool
from ravenjax.robots.raven2.setup import RavenSetup


def as_float32(x: float) -> float:
    """Return x rounded to float32, as a Python number."""
    return float(np.float32(x))


PI = as_float32(math.pi)
PERIOD = as_float32(0.001)  # s, one cycle
TR = transmission.TR.map(as_float32)  # motor rad per joint rad (insertion: per m)
GB_RATIO = (12.25 / (26 / 7)) * (5.005 / 5.675)
"""Insertion motor rad per rad of each tool motor: a double, in the original's order."""
C01, C02, C12 = (as_float32(c) for c in (transmission.C01, transmission.C02, transmission.C12))
TAU_PER_AMP = (transmission.TORQUE_PER_AMP * transmission.GEARBOX).map(as_float32)
"""N m at the capstan per A, unsigned."""

GAINS = resources.read_tables(__file__, "gains.toml")
"""Gains of the motors by software and arm, as `motor_control.MotorControlParams`."""


def jaw_commands(software: str) -> tuple[int, int, int]:
    """Return the gain of the jaws' increments, and the smallest and largest opening, mrad. Source:
    local_io.cpp of raven2 and of the 2015 fork.
    """
    gain, lowest_deg = (1, -10.0) if software == "raven2" else (2, -30.0)
    return gain, int(math.radians(lowest_deg) * 1000.0), int(math.radians(90.0) * 1000.0)


def wrist_coupling(tool: str) -> float:
    """Return the rotation of each jaw per rotation of the wrist, rad/rad."""
    return as_float32(find_tool(tool).wrist_coupling)


def amps_per_torque(arm: str, tool: str, software: str) -> Vec:
    """Return A per N m at the capstan (7), signed: a float32 reciprocal."""
    torques = TAU_PER_AMP.map(mul, transmission.tau_signs(arm, tool, software))
    return torques.map(lambda torque: float(np.float32(1.0) / np.float32(torque)))


def joint_limits(setup: RavenSetup) -> tuple[list[tuple[float, float]], float | None]:
    """Return the limits to which joint targets are clamped: those of the first arm's tool.

    The result contains (lower, upper) of shoulder, elbow (rad), insertion (m), tool_roll, wrist
    (rad), and the jaws' lower yaw limit (rad; None: no limit). All but the fork's roll are float32.
    """
    # Five joints, then the yaw
    (*lower, lowest_yaw), upper = limits.soft_limits(setup.tools[0], setup.software)
    ranges = list(zip(map(as_float32, lower), map(as_float32, upper[:5]), strict=True))
    if setup.software == "fork2015":
        # The fork's limit of the roll is a double, a literal in its r2_kinematics.cpp.
        ranges[3] = (lower[3], upper[3])
    return ranges, None if lowest_yaw is None else as_float32(lowest_yaw)
