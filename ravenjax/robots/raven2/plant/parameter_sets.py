"""Every set of mechanical parameters that a campaign can choose by name, of seven joints each.

The authors' sets
-----------------

Motor, cable and friction values: the authors' published sets for joints 1-3, documented values
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

Set `power_consistent`
----------------------

Motors, gears, cables and friction of a robot in which both sides of every gear carry the same
power.

Units are the authors': torques after the gearbox, inertia and speed of the shaft.
With Newton's law of the shaft, `J m'' = tau_shaft - a gamma`, times the gearbox ratio N, the
inertia is N J and the motor feels N times the cable's torque. The authors have it once, so that
their motor pulls 12.25 times as hard at the cable as statics allow, and feels the links' weight
12.25 times too little. The recording of a real arm tells the two apart: see
docs/explanation/mechanics.md.

What the recordings cannot tell is from catalogues and the original software, or assumed and named
so:

- Motors: maxon catalogue 2012, RE 40 order 148877 (48 V, 1.16 ohm, rotor 142 g cm2) and RE 30 order
  310009 (48 V, 2.52 ohm, 33.5 g cm2), which have the torque constants of raven2's motor.h, 60.3 and
  53.8 mN m/A. Gear GP 42 at its input: 15 g cm2. The authors' clamp of 790 rad/s is the no-load
  speed of the first at 48 V.
- Supply: 48 V, the motors' nominal voltage; assumed of the robot. Amplifiers: 12 A and 6 A at full
  scale of the DAC (raven2: defines.h), taken for their largest current. i_max of motor.h, 10 A, is
  enforced nowhere.
- Cables, and viscous friction of the joints: the authors', which belong to the cable and the joint,
  not to the gear.
- Dry friction, viscous friction of the motors, offsets: fitted to the first half of a recording
  each, joints 1-3 to the arm of the authors, joints 4-7 to another one (`ravenjax reproduce
  mechanics`). How friction is shared between motor and joint is told weakly: where the two halves
  of a sum are uncertain, the sum is not.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

from ravenjax.errors import UserError, suggestion
from ravenjax.robots.raven2.geometry.transmission import GP32, GP42, TORQUE_PER_AMP
from ravenjax.robots.raven2.plant import drives

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


def _times(base: Three, factor: Three) -> Three:
    return (base[0] * factor[0], base[1] * factor[1], base[2] * factor[2])


# Active input, two_arm_dyn.cpp: u = (k DAC + b) g with b = (-1.153*.0416138, -.9*.0697023,
# +.4*.0391082); drive = -u.
_ACTIVE_GAIN: Three = (0.9, 1.0, 0.9)
_ACTIVE_BIAS: Three = (0.9 * 1.153 * 0.0416138, 0.9 * 0.0697023, -0.9 * 0.4 * 0.0391082)


def _seven(positioning: tuple[float, ...], tool: float) -> tuple[float, ...]:
    return (*positioning, tool, tool, tool, tool)


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
) -> ParameterSet:
    """One published set: of shoulder, elbow and insertion, each as a multiple of the base."""
    return ParameterSet(
        torque_per_count=_seven((torque_per_count,) * 3, TOOL_TORQUE_PER_COUNT),
        gain=_seven(gain, 1.0),
        bias=_seven(bias, 0.0),
        motor_inertia=_seven((MOTOR_INERTIA,) * 3, TOOL_MOTOR_INERTIA),
        motor_coulomb=_seven(_times(BASE_MOTOR_COULOMB, motor_coulomb), TOOL_MOTOR_COULOMB),
        motor_viscous=_seven(_times(BASE_MOTOR_VISCOUS, motor_viscous), TOOL_MOTOR_VISCOUS),
        reaction_scale=_seven((1.0, 1.0, 1.0), TOOL_GEARBOX),
        torque_limit=(UNLIMITED,) * 7,
        stall_torque=(UNLIMITED,) * 7,
        back_emf=(0.0,) * 7,
        stiffness=_seven(_times(BASE_STIFFNESS, stiffness), TOOL_CABLE_STIFFNESS),
        damping=_seven(_times(BASE_DAMPING, damping), TOOL_CABLE_DAMPING),
        strength=(UNLIMITED,) * 7,
        link_coulomb=_seven(_times(BASE_LINK_COULOMB, link_coulomb), TOOL_LINK_COULOMB),
        link_viscous=_seven(_times(BASE_LINK_VISCOUS, link_viscous), TOOL_LINK_VISCOUS),
    )


# Sets A to E state no input of their own: they get the active one.
SETS: dict[str, ParameterSet] = {
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

SUPPLY_V = 48.0


def _motor(torque_constant: float, resistance: float, gearbox: float) -> tuple[float, float]:
    """Stall torque at the supply (N m after gearbox) and back EMF (N m s/rad, the same per shaft
    speed).
    """
    return (
        gearbox * torque_constant * SUPPLY_V / resistance,
        gearbox * torque_constant**2 / resistance,
    )


_RE40 = _motor(TORQUE_PER_AMP[0], 1.16, GP42)
_RE30 = _motor(TORQUE_PER_AMP[3], 2.52, GP32)

POWER_CONSISTENT = dataclasses.replace(
    SETS["traj3"],
    torque_per_count=_seven((CONTROLLER_TORQUE_PER_COUNT,) * 3, TOOL_TORQUE_PER_COUNT),
    gain=(1.0,) * 7,
    # N m; what amplifier and modelled gravity leave
    bias=(0.0108, 0.0186, -0.0196, 0.0048, 0.0001, 0.0114, 0.0090),
    # kg m2 in the equation's units
    motor_inertia=_seven((GP42 * (142e-7 + 15e-7),) * 3, TOOL_MOTOR_INERTIA),
    # N m after gearbox
    motor_coulomb=(0.0254, 0.0782, 0.0607, 0.0244, 0.0085, 0.0223, 0.0162),
    # N m s/rad of the shaft
    motor_viscous=(1.83e-3, 1.70e-3, 0.85e-3, 1.2e-3, 2.8e-3, 2.8e-3, 0.31e-3),
    reaction_scale=_seven((GP42,) * 3, TOOL_GEARBOX),
    # N m after gearbox, at 12 A and 6 A
    torque_limit=_seven((12.0 * TORQUE_PER_AMP[0] * GP42,) * 3, 6.0 * TORQUE_PER_AMP[3] * GP32),
    stall_torque=_seven((_RE40[0],) * 3, _RE30[0]),
    back_emf=_seven((_RE40[1],) * 3, _RE30[1]),
    strength=_seven((drives.POSITIONING_STRENGTH,) * 3, drives.TOOL_STRENGTH),
    # N m; insertion N
    link_coulomb=(0.268, 0.213, 5.53, 0.0110, 0.0036, 0.0071, 0.0078),
    link_viscous=_seven((0.00505, 0.00245, 0.0053), TOOL_LINK_VISCOUS),
)


def parameter_set(name: str) -> ParameterSet:
    """The set of that name, or a UserError that lists the names."""
    sets = {"power_consistent": POWER_CONSISTENT, **SETS}
    if name not in sets:
        raise UserError(
            f"unknown parameter set {name!r}: expected one of"
            f" {', '.join(sets)}{suggestion(name, sets)}"
        )
    return sets[name]


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
