"""Transmission between motors and joints: ratios, coupling, signs, and torque of a DAC count.

Constants are Python numbers, and functions compute in the type of their input. Results differ from
those of the software raven2 in the last bits, because raven2 rounds TR and all cable couplings to
float32 and has another order of operations. `original.constants` rounds as raven2 does. Sources:
raven2 `include/raven/defines.h` (geometry), `fwd_cable_coupling.cpp`, `inv_cable_coupling.cpp`,
`motor.h`, `init.cpp`, `state_estimate.cpp`. The 2015 fork is built without OPPOSE_GRIP: both of its
jaws have the signs of the second jaw.
"""

import math

import numpy as np

from ravenjax.numbers import Scalar, Vec
from ravenjax.numbers.algebra import add, mul, sub
from ravenjax.robots.raven2.geometry.tools import find_tool

GP42 = 49 / 4  # gearbox of shoulder, elbow, insertion
GP32 = 26 / 7  # gearbox of the tool joints
_CAPSTAN42 = 5.675e-3  # m, 11.35 mm / 2
_CAPSTAN32 = 5.005e-3  # m, 4.7 mm plus half of a 0.61 mm cable
_TOOL_CAPSTAN = 10.905e-3  # m, 10.6 mm plus half of a 0.61 mm cable
_LINK1_PULLEY = 63.095e-3  # m, 62.5 mm plus half of a 1.19 mm cable; so are the next three
_LINK2_PULLEY = 41.445e-3  # m
_LINK2_IDLER_LARGE = 8.415e-3  # m
_LINK2_IDLER_SMALL = 6.195e-3  # m
_TOOL = _TOOL_CAPSTAN / _CAPSTAN32 * GP32

# motor rad per joint rad (insertion: per m), gearbox included, both arms
TR = Vec(
    (
        _LINK1_PULLEY / _CAPSTAN42 * GP42,
        _LINK2_PULLEY / _LINK2_IDLER_SMALL * _LINK2_IDLER_LARGE / _CAPSTAN42 * GP42,
        GP42 / _CAPSTAN42,
        _TOOL * 120 / 180,
        _TOOL * 200 / 180,
        _TOOL * 100 / 90,
        _TOOL * 100 / 90,
    )
)
GEARBOX = Vec((GP42, GP42, GP42, GP32, GP32, GP32, GP32))  # motor turns per capstan turn
# rad of the insertion motor per rad by which it turns each tool motor
GB_RATIO = GP42 / GP32 * (_CAPSTAN32 / _CAPSTAN42)

C01 = 0.14545  # rad/rad, coupling of the shoulder into the elbow
C02 = 0.0077973826  # m/rad, coupling of the shoulder into the insertion
C12 = 0.008077387  # m/rad, coupling of the elbow into the insertion

JOINT_PER_CAPSTAN_TORQUE = TR / GEARBOX
"""Nm (insertion: N) at the joint per Nm at the capstan, without coupling."""
ENCODER_COUNTS = 4000  # counts per motor turn
ENCODER_RAD = 2 * math.pi / ENCODER_COUNTS  # rad of motor angle per count
TORQUE_PER_AMP = Vec((0.0603,) * 3 + (0.0538,) * 4)  # Nm/A at the motor shaft: RE40, RE30
# DAC counts per A, whole numbers in the original
COUNTS_PER_AMP = Vec((2730.0,) * 3 + (5461.0,) * 4)
COUNTS_PER_NM = COUNTS_PER_AMP / (TORQUE_PER_AMP * GEARBOX)
"""DAC counts per Nm at the capstan (after the gearbox), unsigned."""
TORQUE_PER_COUNT = TORQUE_PER_AMP * GEARBOX / COUNTS_PER_AMP
"""Nm at the capstan per DAC count, unsigned, as the control software assumes."""
CABLE_PER_MOTOR = (_CAPSTAN42 / GP42,) * 3 + (_CAPSTAN32 / GP32,) * 4
"""m of cable per rad of each motor."""


def coupling_signs(arm: str, tool: str, software: str = "raven2") -> Vec:
    """Return the signs (1 or -1) with which the insertion motor turns the tool motors tool_roll,
    wrist, grasp1, grasp2. They depend on the adapter of the tool, the arm and the software.
    """
    style = find_tool(tool).style
    sign = 1.0 if style == "raven" else -1.0
    # Only a square_raven adapter has the same signs on both arms
    if arm == "green" and style != "square_raven":
        sign = -sign
    return _tool_signs(sign, software)


def _tool_signs(sign: float, software: str) -> Vec:
    """Return the signs (4) of the tool motors. In raven2, the jaws' signs differ (OPPOSE_GRIP)."""
    return Vec((sign, sign, sign if software == "fork2015" else -sign, sign))


def tau_signs(arm: str, tool: str, software: str = "raven2", square: float = 1.0) -> Vec:
    """Return the signs (7) of DAC counts that turn motors forward: tau_per_amp of raven2. square:
    with a square_raven adapter, the sign of tool motors is this factor times that of motors 1-3.
    """
    positioning = -1.0 if arm == "gold" else 1.0
    tool_sign = {"raven": -1.0, "dv": 1.0, "square_raven": square * positioning}
    signs = _tool_signs(tool_sign[find_tool(tool).style], software)
    return Vec((positioning, positioning, positioning, *signs))


def encoder_signs(arm: str, tool: str, software: str = "raven2") -> Vec:
    """Return the signs (7) by which encoder counts are multiplied to get forward motor angles.
    Counts are as unpacked from USB, where they are already negated. In the original, the signs
    depend on the adapter for which it is compiled; in this function, on the adapter of the tool.
    """
    return tau_signs(arm, tool, software, square=-1.0)


def motor_from_joint(
    arm: str, tool: str, jpos: Vec, mpos_insertion: Scalar = None, software: str = "raven2"
) -> Vec:
    """Return the motor angles (7, rad) at the joints `jpos` (7, rad and m). The angles of the tool
    motors depend on the angle of the insertion motor. mpos_insertion: this angle, rad; default: the
    angle that follows from `jpos`. The control software passes the measured angle.
    """
    shoulder, elbow, insertion, roll, wrist, grasp1, grasp2 = jpos
    mpos = (
        TR[0] * shoulder,
        TR[1] * (elbow + C01 * shoulder),
        TR[2] * (insertion + C02 * shoulder + C12 * elbow),
    )
    insertion_part = (mpos[2] if mpos_insertion is None else mpos_insertion) * (1.0 / GB_RATIO)
    # A turn of the wrist also turns the jaws by this part, which the motors of the jaws compensate
    wrist_part = mul(find_tool(tool).wrist_coupling, wrist)
    tool_joints = roll, wrist, add(grasp1, wrist_part), sub(grasp2, wrist_part)
    signs = coupling_signs(arm, tool, software)
    tools = Vec(TR[3:]).map(lambda tr, q, s: tr * q + mul(s, insertion_part), tool_joints, signs)
    return Vec((*mpos, *tools))


def joint_from_motor(arm: str, tool: str, mpos: Vec, software: str = "raven2") -> Vec:
    """Return the joints (7, rad and m) at the motor angles `mpos` (7, rad)."""
    # The inverse of `motor_from_joint`, joint by joint
    shoulder = mpos[0] * (1.0 / TR[0])
    elbow = mpos[1] * (1.0 / TR[1]) - C01 * shoulder
    insertion = mpos[2] * (1.0 / TR[2]) - C02 * shoulder - C12 * elbow
    insertion_part = mpos[2] * (1.0 / GB_RATIO)
    signs = coupling_signs(arm, tool, software)
    roll, wrist, grasp1, grasp2 = Vec(mpos[3:]).map(
        lambda motor, s, tr: (motor - mul(s, insertion_part)) * (1.0 / tr), signs, TR[3:]
    )
    wrist_part = mul(find_tool(tool).wrist_coupling, wrist)
    jaws = sub(grasp1, wrist_part), add(grasp2, wrist_part)
    return Vec((shoulder, elbow, insertion, roll, wrist, *jaws))


def motor_matrix(arm: str, tool: str, software: str = "raven2") -> tuple[tuple[float, ...], ...]:
    """Return the 7 x 7 matrix (motors x joints) of `motor_from_joint` without `mpos_insertion`."""
    unit_vectors = [Vec(row) for row in np.eye(7).tolist()]
    columns = [motor_from_joint(arm, tool, unit, software=software) for unit in unit_vectors]
    return tuple(zip(*columns, strict=True))
