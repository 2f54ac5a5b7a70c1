"""Motor control: inverse cable coupling, motor-position PID, gravity compensation -> tau_d.

raven2: inv_cable_coupling.cpp, pid_control.cpp, grav_comp.cpp, rt_raven.cpp; params/r2params.yaml.
The fork of raven2 from 2015 computes the gravity torque and does not add it to tau_d.
"""

import numpy as np

from ravenjax.numbers import describe_fields, jnp, narrow_numbers, widen_numbers
from ravenjax.numbers.vec import Scalar, Vec, record, where
from ravenjax.robots.raven2.geometry import transmission
from ravenjax.robots.raven2.original import constants as stored
from ravenjax.robots.raven2.original.literal import select_evaluation
from ravenjax.robots.raven2.setup import ArmName, RavenSetup


@describe_fields
@record
class MotorControlParams:
    """Gains of seven motors, from motor angle to torque (raven2: params/r2params.yaml)."""

    kp: Vec
    kd: Vec
    ki: Vec
    mvel_d: Vec


@record
class MotorControlState:
    mpos_d: Vec  # 7 rad, unchanged below run level 2
    integral: Vec  # 7 motor rad s; not reset by pedal changes and E-stops
    tau_d: Vec  # 7 N m at the capstan, unchanged below run level 2
    tau_g: Vec  # 3 N m at the capstan, unchanged below run level 2


def params(setup: RavenSetup, arm: ArmName) -> MotorControlParams:
    """Return the gains of the robot's parameter file."""
    number = np.dtype(setup.precision.narrow).type
    gains = stored.GAINS[setup.software][arm].items()
    return MotorControlParams(**{name: Vec(map(number, row)) for name, row in gains})


def init(setup: RavenSetup, arm: ArmName, tool: str, jpos: Vec) -> MotorControlState:
    """Return the state of an arm at rest at `jpos`, with zero integrals."""
    to_stored = np.dtype(setup.precision.narrow).type
    rest, zero = Vec(to_stored(float(j)) for j in jpos), to_stored(0.0)
    # The targets of tool motors depend on the insertion motor, which the first call computes.
    without_coupling = motor_targets(setup, arm, tool, rest, Vec.full(7, zero))
    motors = motor_targets(setup, arm, tool, rest, without_coupling)
    return MotorControlState(
        motors.map(to_stored), Vec.full(7, zero), Vec.full(7, zero), Vec.full(3, zero)
    )


def motor_targets(setup: RavenSetup, arm: ArmName, tool: str, jpos_d: Vec, mpos: Vec) -> Vec:
    """Return the motor positions (rad) for desired joints `jpos_d` (rad, m). mpos: measured, rad.

    As in raven2, contributions of joints are computed in the narrow type (float). The contribution
    of the *measured* insertion motor to the tool motors is computed in the wide type (double).
    """
    ratio, jaw_per_wrist = stored.TR, stored.wrist_coupling(tool)
    signs = transmission.coupling_signs(arm, tool, setup.software)
    shoulder, elbow, insertion, roll, wrist, grasp1, grasp2 = jpos_d
    if jaw_per_wrist:
        bend = jaw_per_wrist * wrist
        grasp1, grasp2 = grasp1 + bend, grasp2 - bend
    insertion_motion = widen_numbers(setup, mpos[2]) / stored.GB_RATIO

    def tool_motor(i: int, joint: Scalar) -> Scalar:
        # Returns the angle of motor i (3 to 6, from 0). `signs` has only the four tool motors.
        motor = widen_numbers(setup, ratio[i] * joint)
        return narrow_numbers(
            setup, motor + insertion_motion if signs[i - 3] > 0 else motor - insertion_motion
        )

    return Vec(
        (
            ratio[0] * shoulder,
            ratio[1] * (elbow + stored.C01 * shoulder),
            ratio[2] * (insertion + stored.C02 * shoulder + stored.C12 * elbow),
            *map(tool_motor, range(3, 7), (roll, wrist, grasp1, grasp2)),
        )
    )


def motor_torques(
    setup: RavenSetup,
    arm: ArmName,
    params: MotorControlParams,
    state: MotorControlState,
    mpos_d: Vec,
    jpos: Vec,
    mpos: Vec,
    mvel: Vec,
    active: Scalar,
    pedal_down: Scalar,
) -> MotorControlState:
    """Return the state with the capstan torques of one arm.

    The PID acts if `pedal_down`, also during a soft E-stop, which only sets the DAC to zero.
    raven2 adds the gravity torque. Below run level 2 (not `active`), targets and torques remain
    unchanged. The integral changes only if `pedal_down`.
    """
    error = mpos_d - mpos
    integral = where(pedal_down, state.integral + error * stored.PERIOD, state.integral)
    pid = params.kp * error + params.kd * (params.mvel_d - mvel) + params.ki * integral
    tau = pid.map(lambda torque: jnp.where(pedal_down, torque, 0.0))
    tau_g = state.tau_g
    if setup.software == "raven2":
        gravity = gravity_torques(setup, arm, jpos)
        tau = Vec((*(Vec(tau[:3]) + gravity), *tau[3:]))
        tau_g = where(active, gravity, tau_g)
    return MotorControlState(
        where(active, mpos_d, state.mpos_d), integral, where(active, tau, state.tau_d), tau_g
    )


def gravity_torques(setup: RavenSetup, arm: ArmName, jpos: Vec) -> Vec:
    """Return the torques that compensate gravity at joints 1-3, N m at the capstan."""
    return narrow_numbers(
        setup, select_evaluation(setup).gravity_torque(arm, widen_numbers(setup, jpos))
    )
