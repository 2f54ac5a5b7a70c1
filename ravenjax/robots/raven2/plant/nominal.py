"""The nominal model: what the instrument would do if nothing went wrong. Euler-Lagrange at joint
torque level.

    M(q) q'' + C(q, q') q' + G(q) = tau - Kv q' - Kc sign(q')   first five joints; jaws locked in M
    tau = kp (q_d - q) - kd q' + G(q)                            insertion: + ki times the integral of (q_d - q)
    q'' = kp (q_d - q) - kd q'                                   each jaw, a double integrator

PD on joints 1, 2, 4-7 and PID on joint 3, as the Raven-II surgical training simulator has it; its
gains are not published.

Gains, chosen once: the model has no rotors, so its loop is made dynamically similar to the robot's.
The control software's PD acts on a motor of inertia Im with viscous friction tau_v; reflected link
inertia adds little. Per unit of joint inertia I (the diagonal of M at the home pose) the model gets
the same natural frequency, damping and friction dead band:

    kp = I KP g / J,  kd = I KD g / J,  Kv = I (tau_v + rho Fv / TR^2) / J,  Kc = I (tau_c + rho Fc / TR) / (J TR)

with J = Im + rho M / TR^2, KP and KD from raven2's r2params.yaml, g the gain from commanded to real
torque, and Im, tau, F and the reaction share rho of the robot's parameter set
(`parameter_sets.nominal`). Nothing is fitted to a published outcome. `Kv` and `Kc` of a jaw are
zero but for the viscous part, which is in its kd. ki: the robot's insertion has no integral; a slow
one (time constant 4 s) removes the dead band's remainder without changing the lag on surgical
motion.

Integration is linearly implicit in gains and friction: stable at 1 kHz for any of them.
"""  # noqa: E501

from __future__ import annotations

from typing import Annotated

import numpy as np

from ravenjax.numbers.algebra import mul
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.linear_solve import solve_spd
from ravenjax.numbers.quantity import Quantity
from ravenjax.numbers.vec import Scalar, Vec, cast, record, where
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.dynamics import link_dynamics
from ravenjax.robots.raven2.geometry import kinematics, limits, transmission
from ravenjax.robots.raven2.plant import nominal_target, parameter_sets, published
from ravenjax.robots.raven2.plant.friction import OPPOSES, coulomb_damping
from ravenjax.robots.raven2.plant.nominal_target import Clean
from ravenjax.robots.raven2.setup import RavenSetup

TICK_S = 1e-3
LAGRANGE = 5  # joints of the Euler-Lagrange equation; the two jaws are double integrators
INSERTION = 2

# Diagonal of M at the home pose (kg m2; insertion kg), both arms; unit inertia for the jaws.
INERTIA = (0.21635879, 0.10039008, 0.407, 6.5508e-7, 1.13110e-6, 1.0, 1.0)
# raven2: params/r2params.yaml, gold, N m after gearbox per motor rad and per motor rad/s.
KP = (0.3, 0.3, 0.15, 0.09, 0.05, 0.05, 0.05)
KD = (0.008, 0.008, 0.012, 0.001, 0.0, 0.0, 0.0)
INTEGRAL_RATE = 0.25  # 1/s, ki / kp of the insertion


_STABLE = "the model is stable"


@record
class NominalParams:
    kp: Annotated[
        Vec,
        Quantity(
            "N m/rad; insertion N/m; jaws 1/s2",
            0,
            1e6,
            "stiffness with which the nominal model follows its target",
            why=_STABLE,
        ),
    ]
    kd: Annotated[
        Vec,
        Quantity(
            "N m s/rad; insertion N s/m; jaws 1/s",
            0,
            1e6,
            "damping with which the nominal model follows its target",
            why=_STABLE,
        ),
    ]
    ki: Annotated[
        Scalar,
        Quantity("N/(m s)", 0, 1e6, "integral gain of the nominal model's insertion", why=_STABLE),
    ]
    kv: Annotated[  # 5: no jaws
        Vec,
        Quantity(
            "N m s/rad; insertion N s/m",
            0,
            1e6,
            "viscous friction of the nominal model's joints",
            why=OPPOSES,
        ),
    ]
    kc: Annotated[  # 5: no jaws
        Vec,
        Quantity(
            "N m; insertion N", 0, 1e6, "dry friction of the nominal model's joints", why=OPPOSES
        ),
    ]
    mass_scale: Annotated[
        Scalar,
        Quantity(
            "",
            0.01,
            100,
            "times masses and inertias of the nominal model",
            why="masses are positive",
        ),
    ]
    resync: Annotated[  # int32; 1: where it is measured
        Scalar,
        Quantity(
            "",
            0,
            1,
            "while the pedal is up the nominal model 1: stands where the robot is, 0: stays where"
            " it was",
            whole=True,
        ),
    ]
    target: nominal_target.TargetParams


@record
class NominalState:
    jpos: Vec  # rad; insertion m
    jvel: Vec  # rad/s; insertion m/s
    integral: Scalar  # m s, of the insertion's error
    target: nominal_target.TargetState


@record
class NominalOutput:
    jpos: Vec  # rad; insertion m
    tip_position: Vec  # m, 3, frame 0 of the arm
    tip_velocity: Vec  # m/s, 3
    jpos_d: Vec  # rad; insertion m


def params(
    setup: RavenSetup, arm: ArmName, parameter_set: str = parameter_sets.DEFAULT
) -> NominalParams:
    """The gains derived above, for a robot with the mechanics `parameter_set`
    (`parameter_sets.Name`).
    """
    values = parameter_sets.parameter_set(parameter_sets.nominal(parameter_set))
    counts = (published.CONTROLLER_TORQUE_PER_COUNT,) * 3 + (published.TOOL_TORQUE_PER_COUNT,) * 4
    gain = [
        real / stated * g
        for real, stated, g in zip(values.torque_per_count, counts, values.gain, strict=True)
    ]
    inertia, share = values.motor_inertia, values.reaction_scale
    dry, viscous = values.motor_coulomb, values.motor_viscous
    link_dry, link_viscous = values.link_coulomb, values.link_viscous
    link_inertia = [*INERTIA[:LAGRANGE], 0.0, 0.0]

    kp, kd, kv, kc = [], [], [], []
    for i, ratio in enumerate(transmission.TR):
        similar = INERTIA[i] / (inertia[i] + share[i] * link_inertia[i] / ratio**2)
        kp.append(similar * KP[i] * gain[i])
        kd.append(similar * KD[i] * gain[i])
        kv.append(similar * (viscous[i] + share[i] * link_viscous[i] / ratio**2))
        kc.append(similar * (dry[i] + share[i] * link_dry[i] / ratio) / ratio)
    for jaw in range(LAGRANGE, 7):
        kd[jaw] += kv[jaw]
    return NominalParams(
        kp=Vec(kp),
        kd=Vec(kd),
        ki=INTEGRAL_RATE * kp[INSERTION],
        kv=Vec(kv[:LAGRANGE]),
        kc=Vec(kc[:LAGRANGE]),
        mass_scale=1.0,
        resync=np.int32(0),
        target=nominal_target.params(setup),
    )


def init(setup: RavenSetup, arm: ArmName, params: NominalParams, jpos0: Vec) -> NominalState:
    """At rest at `jpos0` (rad, m), which is its target."""
    dtype = setup.precision.real
    jpos = Vec(jnp.asarray(x, dtype) for x in jpos0)
    still = Vec(jnp.asarray(0.0, dtype) for _ in range(7))
    return NominalState(
        jpos=jpos, jvel=still, integral=still[0], target=nominal_target.init(setup, arm, jpos)
    )


def step(
    setup: RavenSetup,
    arm: ArmName,
    params: NominalParams,
    state: NominalState,
    clean: Clean,
    measured: Vec,
) -> tuple[NominalState, NominalOutput]:
    """One tick (1 ms) of the model under the operator's clean command; it holds still while the
    pedal is up.

    measured: the robot's joints as its control software has them (rad, m). With each lift of the
    pedal the robot takes its measured pose, which hangs a little below the desired one, for the
    desired one, and sags on; `NominalParams.resync` lets the model go along, so that clutching adds
    up to no error of its own.
    """
    stands = (params.resync != 0) & (clean.engaged == 0)
    state = NominalState(
        jpos=where(stands, measured, state.jpos),
        jvel=state.jvel,
        integral=state.integral,
        target=state.target,
    )
    target = nominal_target.step(setup, arm, params.target, state.target, clean, state.jpos)
    moved = track(setup, arm, params, state, target.jpos_d)
    still = NominalState(
        jpos=state.jpos, jvel=state.jvel * 0.0, integral=state.integral, target=target
    )
    state = where(clean.engaged != 0, _with_target(moved, target), still)
    state = NominalState(
        jpos=cast(state.jpos, setup.precision.real),
        jvel=cast(state.jvel, setup.precision.real),
        integral=cast(state.integral, setup.precision.real),
        target=state.target,
    )
    return state, observe(arm, state)


def observe(arm: ArmName, state: NominalState) -> NominalOutput:
    """Tip and joints of a state."""
    return NominalOutput(
        jpos=state.jpos,
        tip_position=kinematics.forward(arm, state.jpos).position,
        tip_velocity=kinematics.tip_velocity(arm, state.jpos, state.jvel),
        jpos_d=state.target.jpos_d,
    )


def track(
    setup: RavenSetup, arm: ArmName, params: NominalParams, state: NominalState, jpos_d: Vec
) -> NominalState:
    """The dynamics alone: one tick towards the joint target `jpos_d` (rad, m)."""
    dt = TICK_S
    jpos, jvel = state.jpos, state.jvel
    error = jpos_d - jpos
    integral = state.integral + dt * error[INSERTION]
    # Jaws are locked: at their home angles, where their few grams sit about the same axis.
    locked = Vec((*jpos[:LAGRANGE], *limits.HOME_JPOS[LAGRANGE:]))
    turning = Vec((*jvel[:LAGRANGE], 0.0, 0.0))
    # The controller's G(q) cancels the model's to the last digit: both are left out, whatever
    # gravity is.
    mass, bias = link_dynamics.mass_matrix_and_bias(
        setup, arm, locked, turning, Vec.full(3, 0.0), params.mass_scale
    )

    system, right = [], []
    for i in range(LAGRANGE):
        row = [mul(1.0 / dt, mass[i][j]) for j in range(i + 1)]
        damping = params.kd[i] + params.kv[i] + dt * params.kp[i]
        row[i] = row[i] + damping
        force = params.kp[i] * error[i] - damping * jvel[i] - bias[i]
        if i == INSERTION:
            force = force + params.ki * integral
        stick = coulomb_damping(params.kc[i], row[i] * jvel[i] + force, row[i])
        row[i] = row[i] + stick
        right.append(force - stick * jvel[i])
        system.append(Vec(row))
    gained = list(solve_spd(tuple(system), Vec(right)))
    for i in range(LAGRANGE, 7):
        damping = params.kd[i] + dt * params.kp[i]
        gained.append((params.kp[i] * error[i] - damping * jvel[i]) / (1.0 / dt + damping))
    jvel = jvel + Vec(gained)
    return NominalState(jpos=jpos + jvel * dt, jvel=jvel, integral=integral, target=state.target)


def _with_target(state: NominalState, target: nominal_target.TargetState) -> NominalState:
    return NominalState(jpos=state.jpos, jvel=state.jvel, integral=state.integral, target=target)
