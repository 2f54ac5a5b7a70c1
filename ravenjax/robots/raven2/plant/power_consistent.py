"""Motors, gears, cables and friction of a robot in which both sides of every gear carry the same
power.

Units are the authors' (see `published`): torques after the gearbox, inertia and speed of the shaft.
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

from ravenjax.robots.raven2.geometry.transmission import GP32, GP42, TORQUE_PER_AMP
from ravenjax.robots.raven2.plant import published

SUPPLY_V = 48.0


def _motor(torque_constant: float, resistance: float, gearbox: float) -> tuple[float, float]:
    """Stall torque at the supply (N m after gearbox) and back EMF (N m s/rad, the same per shaft
    speed).
    """
    return (
        gearbox * torque_constant * SUPPLY_V / resistance,
        gearbox * torque_constant**2 / resistance,
    )


RE40_STALL_TORQUE, RE40_BACK_EMF = _motor(TORQUE_PER_AMP[0], 1.16, GP42)
RE30_STALL_TORQUE, RE30_BACK_EMF = _motor(TORQUE_PER_AMP[3], 2.52, GP32)
RE40_TORQUE_LIMIT = 12.0 * TORQUE_PER_AMP[0] * GP42  # N m after gearbox, at 12 A
RE30_TORQUE_LIMIT = 6.0 * TORQUE_PER_AMP[3] * GP32  # at 6 A
MOTOR_INERTIA = GP42 * (142e-7 + 15e-7)  # kg m2 in the equation's units

BIAS = (
    0.0108,
    0.0186,
    -0.0196,
    0.0048,
    0.0001,
    0.0114,
    0.0090,
)  # N m; what amplifier and modelled gravity leave
MOTOR_COULOMB = (0.0254, 0.0782, 0.0607, 0.0244, 0.0085, 0.0223, 0.0162)  # N m after gearbox
MOTOR_VISCOUS = (
    1.83e-3,
    1.70e-3,
    0.85e-3,
    1.2e-3,
    2.8e-3,
    2.8e-3,
    0.31e-3,
)  # N m s/rad of the shaft
LINK_COULOMB = (0.268, 0.213, 5.53, 0.0110, 0.0036, 0.0071, 0.0078)  # N m; insertion N
LINK_VISCOUS = (0.00505, 0.00245, 0.0053, *(published.TOOL_LINK_VISCOUS,) * 4)
