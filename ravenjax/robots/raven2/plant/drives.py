"""Computes forces on the joints of one arm: motors, brakes, cables, dry friction and hard stops.

**Motors.** The shaft of a motor has the speed w, the inertia Im, dry friction tau_c (which a closed
brake increases) and viscous friction tau_v. Torques are those after the gearbox, inertia and speed
those of the shaft (the units of the model's authors, see models/raven2/mechanics.toml):

    Im w' = drive - tau_c sgn(w) - tau_v w - reaction_scale * lambda

`lambda` is the torque of the cable (below), and `reaction_scale` the authors' factor of this torque
on the motor. The dry friction depends on the joint's speed of the last step; all other terms are
implicit. The speed at the end of a step is therefore an affine function of the speeds q' of the
joints, and is eliminated from the equations of the links (T: see below; other numbers:
`EliminatedMotor`):

    w = (known_torque + coupling * T q') * inverse

**Encoders** have 4000 counts per turn on every motor (raven2: defines.h). The motor angle is stored
as whole counts (int32) plus a fraction of a count, so the reading is exact. An angle near 900 rad
in float32 would lose increments below 3e-5 rad per millisecond.

**Cables** between capstan and joint are the exponential spring-damper of the model's authors,
linearised once per step. The stretch of a cable is stored as a motor angle, `epsilon = m - T q`
(rad), where T is the motor matrix. At zero stretch, encoders, cable coupling of the control
software and links agree exactly. At the capstan the stretch is `delta = a epsilon` (m) with a =
capstan radius / gearbox ratio. The tension difference is `gamma = ke (exp(delta) - exp(-delta)) + 2
be delta'` (CSLDepend/raven2_sim, Li_DYN/two_arm_dyn.cpp). In motor coordinates it is `lambda = a
gamma`. The torque on the motor is `-reaction_scale * lambda`, and on the joints `T^T lambda`.

**Friction.** A force with `sign(velocity)` alternates at rest, and a smoothed sign lets the joint
creep. Dry friction therefore acts as a damping, computed anew for each step. Let v0 be the velocity
at the end of the step without dry friction, and `inertia_rate` the inertia divided by the step,
plus all other implicit damping. To stop the joint, friction must balance the force `drive =
inertia_rate * v0`. If `level`, the force of dry friction, is greater than |drive|, the joint stops:
its damping is so large that the velocity ends at zero within `CREEP`. Otherwise the joint slides
with the velocity v1 = (|drive| - level) / inertia_rate, and its damping is level / v1.

**Brakes** act on motors 1-3 only (RE40); tool motors run free without power. A brake engages and
releases some time after the PLC's command. It adds dry friction of its holding torque, and slips
above that torque. No source gives the data of the brakes.

**Hard stops** are one-sided stiff springs at the positions against which the control software homes
(raven2: defines.h, homing.cpp, tools.cpp). They are shoulder 0 deg, elbow 137.5 deg, insertion
0.562 m, and the tool's angles. The other ends of the first three joints are not published. They are
assumed 2.5 deg (insertion 2 mm) beyond the soft limit, as the published ends of elbow and insertion
are. The stiffness is *assumed*: metal on rubber, stiffer than the cable.
"""

import math

from ravenjax.numbers import Scalar, Vec, as_int, clamp, describe_fields, jnp, record
from ravenjax.numbers.algebra import add, mul
from ravenjax.robots.raven2.geometry import limits, transmission
from ravenjax.robots.raven2.geometry.tools import find_tool

CREEP = 1e-7  # largest speed while friction holds a joint, rad/s or m/s: 1 um or urad in 10 s


def coulomb_damping(level: Scalar, drive: Scalar, inertia_rate: Scalar) -> Scalar:
    """Return the damping that acts as dry friction during one step: N m s/rad (insertion: N s/m).

    level: torque or force of the friction, N m (insertion: N). drive: `inertia_rate` times the
    speed at the end of the step without friction, same unit. inertia_rate: inertia divided by the
    step, plus all other implicit damping, N m s/rad (insertion: N s/m).
    """
    # The final speed is drive / (inertia_rate + damping) = sign(drive) excess / inertia_rate. If
    # friction is greater than the force, the lower bound stops the joint.
    excess = jnp.maximum(jnp.abs(drive) - level, 0.0)
    return level * inertia_rate / jnp.maximum(excess, inertia_rate * CREEP)


COUNTS_PER_RAD = transmission.ENCODER_COUNTS / (2.0 * math.pi)


@record
class Angle:
    """A motor angle, relative to a reference count."""

    count: Scalar  # whole counts, int32
    fraction: Scalar  # of a count, -0.5 to 0.5


def advance_angle(angle: Angle, turned: Scalar) -> Angle:
    """Return the angle after turning by `turned` (rad)."""
    counts = add(angle.fraction, turned * COUNTS_PER_RAD)
    whole = jnp.floor(counts + 0.5)
    return Angle(add(angle.count, as_int(whole)), counts - whole)


REFERENCE = Angle(0, 0.0)
"""The angle at the reference count."""


def angle_in_radians(angle: Angle, dtype: str) -> Scalar:
    """Return the angle in rad. It is computed from counts, so rounding errors do not accumulate."""
    return (angle.count.astype(dtype) + angle.fraction) * transmission.ENCODER_RAD


@record
class Linear:
    """`lambda = force + damping * epsilon'`, for the velocity at the end of the step."""

    force: Scalar  # N m (motor coordinates) at zero stretch rate
    damping: Scalar  # N m s/rad, stiffness of the coming step included

    def tension(self, arm: float, rate: Scalar) -> Scalar:
        """Return the tension difference, N. arm: lever, m/rad. rate: stretch rate, rad/s."""
        return (self.force + self.damping * rate) * (1.0 / arm)


def cable_tension(stiffness: Scalar, damping: Scalar, delta: Scalar, rate: Scalar) -> Scalar:
    """Return the tension difference gamma (N) at stretch `delta` (m) and `rate` (m/s)."""
    return 2.0 * stiffness * _sinh(delta) + 2.0 * damping * rate


def linearise_cable(
    arm: float, stiffness: Scalar, damping: Scalar, stretch: Scalar, dt: float
) -> Linear:
    """Return a cable's torque as a function of its stretch rate in the coming `dt` (s): arm times
    the tension 2 stiffness sinh(delta) + 2 damping delta', where delta is the stretch in m.
    arm: lever, m/rad. stretch: rad at the start. stiffness: N. damping: N s/m.
    """
    delta = arm * stretch
    # Derivative of the tension by delta. During dt, delta grows by dt times its rate.
    slope = 2.0 * stiffness * _cosh(delta)
    force = (2.0 * arm) * stiffness * _sinh(delta)
    return Linear(force, (arm * arm) * (dt * slope + 2.0 * damping))


def resting_stretch(arm: float, stiffness: Scalar, force: Scalar) -> Scalar:
    """Return the stretch (rad) at which a resting cable exerts `force` (N m at the motor)."""
    ratio = force / (2.0 * arm * stiffness)
    return jnp.log(ratio + jnp.sqrt(ratio * ratio + 1.0)) / arm


# Stretches are below 1 mm (about 5e-4 m at the published faults). For so small d, exp(d) - exp(-d)
# loses all digits in float32. The series have relative errors of 1e-10 up to 0.1 m.
def _sinh(x: Scalar) -> Scalar:
    square = x * x
    return x * (1.0 + square * (1.0 / 6.0) * (1.0 + square * 0.05))


def _cosh(x: Scalar) -> Scalar:
    square = x * x
    return 1.0 + square * 0.5 * (1.0 + square * (1.0 / 12.0))


@describe_fields
@record
class ActuatorParams:
    """Parameters of seven motors."""

    torque_per_count: Vec  # N m per count
    gain: Vec
    bias: Vec  # N m
    inertia: Vec  # kg m2; Im
    coulomb: Vec  # N m
    viscous: Vec  # N m s/rad
    reaction_scale: Vec
    torque_limit: Vec  # N m
    stall_torque: Vec  # N m
    back_emf: Vec  # N m s/rad


@record
class EliminatedMotor:
    """The effect of one motor and its cable on the equations of the links in this step."""

    known_torque: Scalar  # N m, drive and inertia over the step
    coupling: Scalar  # N m s/rad, reaction per link speed
    inverse: Scalar  # rad/s per N m
    resistance: Scalar  # N m s/rad, all damping but the cable's
    force: Scalar  # N m on the joints (motor coordinates) if the links' speed does not change
    stretch_rate: Scalar  # rad/s if the links' speed does not change
    stiffening: Scalar  # N m s/rad, loss of that force per gain of link speed


def limit_torque(
    torque: Scalar, speed: Scalar, torque_limit: Scalar, stall_torque: Scalar, back_emf: Scalar
) -> Scalar:
    """Return the torque (N m) of a motor at `speed` (rad/s) if `torque` is commanded.
    The amplifier is a current source until its current i, or the voltage R i + k w, reaches a limit
    (R: resistance; k: motor constant; w: speed). The current limit also applies if the motor turns
    faster than the supply could turn it. torque_limit: torque at the current limit, N m.
    stall_torque: largest torque at rest by the voltage limit, N m. back_emf: k^2 / R, loss of this
    torque per speed, N m s/rad.
    """
    induced = back_emf * speed
    torque = jnp.minimum(jnp.maximum(torque, -stall_torque - induced), stall_torque - induced)
    return clamp(torque, -torque_limit, torque_limit)


def eliminate_motor(
    inertia_rate, viscous, coulomb, reaction_scale, drive, speed, link_speed, cable: Linear
) -> EliminatedMotor:
    """Return the motor's speed and the cable's force as functions of the link's speed.

    Let w and v be the speeds of motor and link at the end of the step. The motor's equation of
    motion is resistance w = known_torque + coupling (v - w). So w = (known_torque + coupling v)
    inverse, and the stretch rate of the cable is w - v = (known_torque - resistance v) inverse,
    where inverse is 1 / (resistance + coupling). `stretch_rate` and `force` are the values if the
    link keeps its speed, v = link_speed. `stiffening`: loss of force per gain of v.

    inertia_rate: Im/dt, N m s/rad, a part of `resistance`. viscous, coulomb: friction, N m s/rad
    and N m. reaction_scale: factor of the cable's torque on the motor. drive: torque, N m. speed,
    link_speed: of motor and link, rad/s of motor angle, at the start of the step.
    """
    coupling = mul(reaction_scale, cable.damping)
    known_torque = inertia_rate * speed + drive - mul(reaction_scale, cable.force)
    viscous_rate = add(inertia_rate, viscous)
    driving_torque = known_torque + coupling * link_speed
    friction = coulomb_damping(coulomb, driving_torque, viscous_rate + coupling)
    resistance = viscous_rate + friction
    inverse = 1.0 / (resistance + coupling)
    stretch_rate = (known_torque - resistance * link_speed) * inverse
    return EliminatedMotor(
        known_torque=known_torque,
        coupling=coupling,
        inverse=inverse,
        resistance=resistance,
        force=cable.force + cable.damping * stretch_rate,
        stretch_rate=stretch_rate,
        stiffening=cable.damping * resistance * inverse,
    )


@describe_fields
@record
class BrakeParams:
    holding_torque: Scalar = 0.4 * 12.25  # N m; assumed: maxon AB 28, 0.4 N m at the shaft
    engage_ticks: Scalar = 15  # ms; int32; assumed (relay and spring)
    release_ticks: Scalar = 20  # ms; int32; assumed (coil current rises)


@record
class BrakeState:
    engaged: Scalar  # 1: engaged, int32
    pending_ticks: Scalar  # ms for which the command has differed from the brake's state, int32


def step_brakes(
    params: BrakeParams, state: BrakeState, commanded: Scalar
) -> tuple[BrakeState, Scalar]:
    """Compute one tick with the PLC's command (1: on).
    Returns the new state, and the dry friction that the brakes add to motors 1-3 (N m).
    """
    commanded = as_int(commanded)
    pending_ticks = jnp.where(commanded != state.engaged, state.pending_ticks + 1, 0)
    delay_ticks = jnp.where(commanded != 0, params.engage_ticks, params.release_ticks)
    switches = pending_ticks > delay_ticks
    engaged = jnp.where(switches, commanded, state.engaged)
    state = BrakeState(as_int(engaged), as_int(jnp.where(switches, 0, pending_ticks)))
    return state, jnp.where(engaged != 0, params.holding_torque, 0.0)


# Distance of the stops of joints 1-3 from the soft limits; rad, rad, m
_MARGIN = (math.radians(2.5), math.radians(2.5), 2e-3)
SETTLING_S = 5e-3  # s, damping over stiffness


@describe_fields
@record
class StopParams:
    lower: Vec  # rad; insertion m
    upper: Vec  # rad; insertion m
    stiffness: Vec  # N m/rad; insertion N/m


def stop_params(tool: str) -> StopParams:
    """Return the hard stops of an arm with that tool: positions and stiffnesses."""
    instrument = find_tool(tool)
    # The shoulder's lower stop is its soft limit, without the distance _MARGIN of the other stops.
    lower = Vec(limits.POSITIONING_LOWER) - (0.0, *_MARGIN[1:])
    upper = Vec(limits.POSITIONING_UPPER) + _MARGIN
    return StopParams(
        lower=Vec((*lower, *instrument.hard_min)),
        upper=Vec((*upper, *instrument.hard_max)),
        stiffness=Vec((1e5, 1e5, 1e6, 20.0, 20.0, 20.0, 20.0)),
    )


def stop_force(
    params: StopParams, i: int, jpos: Scalar, jvel: Scalar, dt: float
) -> tuple[Scalar, Scalar]:
    """Return the force of joint i's hard stop (N m; insertion N), and its damping.

    The force is that at the end of a step `dt` (s) at the present speed. The damping is the loss of
    force per gain of speed (N m s/rad; insertion N s/m), by the stop's own damping and because the
    joint penetrates farther during the step. Both are 0 within the joint's range.
    """
    above = jnp.maximum(jpos - params.upper[i], 0.0)
    below = jnp.minimum(jpos - params.lower[i], 0.0)
    penetration = above + below
    damping = jnp.where(penetration != 0.0, params.stiffness[i] * (dt + SETTLING_S), 0.0)
    return -params.stiffness[i] * penetration - damping * jvel, damping
