"""Motor, cable and friction values: the authors' published sets for joints 1-3, documented values
for joints 4-7.

Joints 1-3: CSLDepend/raven2_sim, Li_DYN/two_arm_dyn.cpp and Li_DYN/Matlab (main.m, main.cpp,
global_vars.m). Each set is a multiple of one base. Inputs are stored in *drive form*: motor torque
in the positive motor direction is `gain * (torque per count) * (command, positive for positive
torque) + bias`; the authors write the negative of it for the gold arm, whose positive counts drive
the motor backwards.

Units follow the authors' motor equation, in which torques are those after the gearbox while the
inertia and the velocity are the motor shaft's: `Im mdd = drive - tau_c sgn(md) - tau_v md -
reaction`. Statics would have the cable's reaction 12.25 times larger, so a stalled motor pulls that
much harder here than a real one, and the link's weight is felt that much less: `bias` stands in for
it.
"""

from __future__ import annotations

import dataclasses

from ravenjax.errors import UserError, suggestion

Three = tuple[float, float, float]

AMPLIFIER_VOLTS_PER_COUNT = 0.0003051804379  # Li_DYN/Matlab/main.m
TORQUE_PER_COUNT = (
    AMPLIFIER_VOLTS_PER_COUNT * 1.1442 * 0.0640 * 12.25
)  # N m after gearbox per count, main.m
OLD_TORQUE_PER_COUNT = (
    2.579399807733391e-4  # N m per count, main.cpp: the same with the datasheet's 0.0603 N m/A
)
CONTROLLER_TORQUE_PER_COUNT = 0.0603 * 12.25 / 2730.0  # raven2: motor.h, defines.h

MOTOR_INERTIA = 2.847e-4  # kg m2 in the authors' mixed units
BASE_STIFFNESS: Three = (720e3, 88e3, 9.25e3)  # ke, N/m a side
BASE_DAMPING: Three = (4000.0, 1380.0, 400.0)  # be, N s/m a side
BASE_MOTOR_COULOMB: Three = (8.11e-2, 4.11e-2, 5.11e-2)  # N m after gearbox
BASE_MOTOR_VISCOUS: Three = (1.9e-4, 1.8e-4, 7.1e-4)  # N m s/rad of the shaft
BASE_LINK_COULOMB: Three = (0.505, 0.49, 0.53)  # N m, N m, N
BASE_LINK_VISCOUS: Three = (0.00505, 0.0049, 0.0053)  # N m s/rad, N m s/rad, N s/m


@dataclasses.dataclass(frozen=True)
class PublishedSet:
    """One published set for shoulder, elbow and insertion."""

    stiffness: Three  # ke, N/m
    damping: Three  # be, N s/m
    motor_coulomb: Three  # N m
    motor_viscous: Three  # N m s/rad
    link_coulomb: Three  # N m, N m, N
    link_viscous: Three  # N m s/rad, N m s/rad, N s/m
    torque_per_count: float  # N m per count
    gain: Three  # 1
    bias: Three  # N m in the positive motor direction, at any command


def _times(base: Three, factor: Three) -> Three:
    return (base[0] * factor[0], base[1] * factor[1], base[2] * factor[2])


# Active input, two_arm_dyn.cpp: u = (k DAC + b) g with b = (-1.153*.0416138, -.9*.0697023,
# +.4*.0391082); drive = -u.
_ACTIVE_GAIN: Three = (0.9, 1.0, 0.9)
_ACTIVE_BIAS: Three = (0.9 * 1.153 * 0.0416138, 0.9 * 0.0697023, -0.9 * 0.4 * 0.0391082)


def _set(
    motor_coulomb: Three,
    motor_viscous: Three,
    link_coulomb: Three = (1.0, 1.0, 1.0),
    link_viscous: Three = (1.0, 1.0, 1.0),
    stiffness: Three = (1.0, 1.0, 1.0),
    damping: Three = (1.0, 1.0, 1.0),
    torque_per_count: float = TORQUE_PER_COUNT,
    gain: Three = _ACTIVE_GAIN,
    bias: Three = _ACTIVE_BIAS,
) -> PublishedSet:
    return PublishedSet(
        stiffness=_times(BASE_STIFFNESS, stiffness),
        damping=_times(BASE_DAMPING, damping),
        motor_coulomb=_times(BASE_MOTOR_COULOMB, motor_coulomb),
        motor_viscous=_times(BASE_MOTOR_VISCOUS, motor_viscous),
        link_coulomb=_times(BASE_LINK_COULOMB, link_coulomb),
        link_viscous=_times(BASE_LINK_VISCOUS, link_viscous),
        torque_per_count=torque_per_count,
        gain=gain,
        bias=bias,
    )


# Sets A to E state no input of their own: they get the active one.
SETS: dict[str, PublishedSet] = {
    "traj3": _set(
        (0.5, 1.75, 1.0), (13.0, 13.5, 4.0), link_viscous=(1.0, 0.5, 1.0), stiffness=(1.0, 2.0, 1.0)
    ),
    "A": _set(
        (0.9, 1.2, 2.0),
        (2.0, 12.0, 2.0),
        (1.0, 1.0, 10.0),
        (1.0, 1.0, 10.0),
        damping=(1.0, 1.2, 1.0),
    ),
    "B": _set((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),
    "C": _set((0.75, 2.0, 0.8), (1.0, 15.0, 5.0), (1.0, 1.0, 0.2), (1.0, 0.5, 0.1)),
    "D": _set((0.45, 1.75, 1.0), (14.0, 14.5, 5.3), link_viscous=(1.0, 0.5, 1.0)),
    "E": _set((0.45, 1.75, 1.0), (12.5, 11.5, 5.0), link_viscous=(1.0, 0.5, 1.0)),
    "matlab_main": _set(
        (1.0, 0.8, 5.0),
        (20.0, 15.0, 5.0),
        (0.1, 5.0, 10.0),
        (10.0, 1.0, 10.0),
        damping=(0.25, 1.2, 1.4),
        torque_per_count=OLD_TORQUE_PER_COUNT,
        gain=(0.8, 0.8, 1.0),
        bias=(0.8 * 1.1 * 0.0378, 0.8 * 0.94 * 0.0672, -0.0398),
    ),
    "matlab_global": _set(
        (0.9, 1.2, 2.0),
        (2.0, 12.0, 2.0),
        (1.0, 1.0, 10.0),
        (1.0, 1.0, 10.0),
        stiffness=(1.0, 3.0, 1.0),
        damping=(0.25, 3.0, 1.0),
        torque_per_count=CONTROLLER_TORQUE_PER_COUNT,
        gain=(1.0, 0.85, 1.0),
        bias=(1.27 * 0.0311, 0.85 * 1.035 * 0.0653, -0.97 * 0.0425),
    ),
}


def parameter_set(name: str, others: tuple[str, ...] = ()) -> PublishedSet:
    """The published set of that name, or a UserError that lists the names, those of `others`
    too.
    """
    if name not in SETS:
        names = (*others, *SETS)
        raise UserError(
            f"unknown parameter set {name!r}: expected one of"
            f" {', '.join(names)}{suggestion(name, names)}"
        )
    return SETS[name]


# --- Joints 4-7: roll, wrist, grasp1, grasp2
# -------------------------------------------------------------------------- The same equation in
# the same units.
# Multiplying the shaft equation of an RE30 by its gearbox ratio N makes torques those after the
# gearbox, the inertia
# N J and the cable's reaction N times the shaft's: the authors' form with reaction scale N.

TOOL_GEARBOX = 26.0 / 7.0  # GP32, raven2: defines.h
TOOL_ROTOR_INERTIA = 33.5e-7  # kg m2, maxon RE 30, 60 W (catalogue, torque constant 53.8 mN m/A)
TOOL_GEAR_INERTIA = (
    0.8e-7  # kg m2 at the shaft, maxon GP 32, one stage (catalogue class 0.7 to 1.5 g cm2)
)
TOOL_MOTOR_INERTIA = TOOL_GEARBOX * (
    TOOL_ROTOR_INERTIA + TOOL_GEAR_INERTIA
)  # kg m2 in the equation's units
TOOL_TORQUE_PER_COUNT = (
    0.0538 * TOOL_GEARBOX / 5461.0
)  # N m after gearbox per count, raven2: motor.h, defines.h

# About a third of the RE30's no-load loss (78 mA x 53.8 mN m/A x 3.714 = 16 mN m after the gearbox)
# is dry.
TOOL_MOTOR_COULOMB = 0.006  # N m
# The published wrist and jaw gains have KD = 0, which a tool tolerates only because its drive damps
# itself: the value
# that gives KP = 0.05 N m/rad on this inertia a damping ratio of 0.3.
TOOL_MOTOR_VISCOUS = 2.0 * 0.3 * (0.05 * TOOL_MOTOR_INERTIA) ** 0.5  # N m s/rad
# Wire rope of 0.61 mm: metal area 0.16 mm2, about 100 GPa, 1.5 m from capstan to wrist: E A / L a
# side.
TOOL_CABLE_STIFFNESS = 100e9 * 0.16e-6 / 1.5  # N/m
# Loss time of the authors' shoulder cable, be/ke = 5.6 ms.
TOOL_CABLE_DAMPING = TOOL_CABLE_STIFFNESS * 4000.0 / 720e3  # N s/m
# Pulleys and sheath of an instrument; assumption: a few mN m, well below the 70 mN m at which
# homing sees a hard stop.
TOOL_LINK_COULOMB = 0.004  # N m
TOOL_LINK_VISCOUS = 1e-4  # N m s/rad
