"""Computes the nominal model: how the instrument would move without a fault, from joint torques.

    M(q) q'' + C(q, q') q' + G(q) = tau - Kv q' - Kc sign(q')   first five joints; jaws locked in M
    tau = kp (q_d - q) - kd q' + G(q)             insertion: + ki times the integral of (q_d - q)
    q'' = kp (q_d - q) - kd q'                    each jaw, a double integrator

The controller is PD on joints 1, 2, 4-7 and PID on joint 3, as in the Raven-II surgical training
simulator, whose gains are not published. Unlike the robot, the model has no rotors. Its gains give
it the natural frequency, the damping and the friction dead band of the robot, whose software
controls motors by a PD law. No gain is fitted to a published outcome:

    kp = I KP g / J,  kd = I KD g / J,  J = Im + rho I / TR^2 (jaws: J = Im)
    Kv = I (tau_v + rho Fv / TR^2) / J,  Kc = I (tau_c + rho Fc / TR) / (J TR)

- I: inertia of the joint, from the diagonal of M at the home pose
- Im, tau_v, tau_c: inertia, viscous and dry friction of the motor; Fv, Fc: friction of the link
- rho: share of the cable's torque that acts on the motor; g: gain from commanded to real torque
- TR: transmission ratio from joint to motor; KP, KD: gains of raven2's r2params.yaml

A jaw's kd contains its viscous friction. The robot's insertion has no integral. The model's slow
integral (ki, time constant 4 s) removes the remaining error of the dead band and does not change
the lag on surgical motion. Integration is linearly implicit in gains and friction.

The target is the operator's input before any fault. Its increments are added to a desired pose, and
inverse kinematics near the model's joints gives the desired joints. Desired joints are clamped to
the software's joint limits, and the desired pose becomes that of the clamped joints. While the
pedal is up the model stands still, and its target is its pose, as in the robot.
"""

import numpy as np

from ravenjax.numbers import cast_to_real, describe_fields
from ravenjax.numbers.algebra import dot, mul, solve_spd
from ravenjax.numbers.vec import Scalar, Vec, as_int, clamp, record, replace, to_int32, where
from ravenjax.robots.raven2.dynamics import link_dynamics
from ravenjax.robots.raven2.geometry import kinematics, limits, mapping, transmission
from ravenjax.robots.raven2.original import constants as stored
from ravenjax.robots.raven2.plant import parameter_sets
from ravenjax.robots.raven2.plant.drives import coulomb_damping
from ravenjax.robots.raven2.setup import ArmName, RavenSetup
from ravenjax.vocabulary import TICK_S

COUPLED_JOINTS = 5  # joints with the mass matrix M; the two jaws are double integrators
INSERTION = 2

# Diagonal of M at the home pose (kg m2; insertion kg), both arms; unit inertia for the jaws.
INERTIA = (0.21635879, 0.10039008, 0.407, 6.5508e-7, 1.13110e-6, 1.0, 1.0)
INTEGRAL_RATE = 0.25  # 1/s, ki / kp of the insertion
UM_PER_M = 1e6


@describe_fields
@record
class TargetParams:
    """Limits to which targets are clamped: the software's joint limits, the same for every arm."""

    lower: Vec  # 5, without the jaws; rad, insertion m
    upper: Vec  # 5, without the jaws; rad, insertion m


@record
class Command:
    """The operator's command to one arm in this tick, before any fault."""

    delta_um: Vec  # 3, um, int32: ITP-frame increment, or position in frame 0 (absolute)
    quat: Vec  # x, y, z, w: ITP-frame increment, or orientation in frame 0
    grasp_mrad: Scalar  # mrad, int32: increment (positive closes), or opening
    engaged: Scalar  # 1: pedal down, int32 or bool


@record
class TargetState:
    position_um: Vec  # 3, um, int32, target in frame 0
    quat: Vec  # x, y, z, w, unit, target orientation in frame 0
    grasp_mrad: Scalar  # mrad, int32, target opening
    jpos_d: Vec  # rad; insertion m: target joints


@describe_fields
@record
class NominalParams:
    kp: Vec  # N m/rad; insertion N/m; jaws 1/s2
    kd: Vec  # N m s/rad; insertion N s/m; jaws 1/s
    ki: Scalar  # N/(m s)
    kv: Vec  # N m s/rad; insertion N s/m; 5, without the jaws
    kc: Vec  # N m; insertion N; 5, without the jaws
    mass_scale: Scalar
    resync: Scalar  # int32; 1: the model follows the robot's measured pose while the pedal is up
    target: TargetParams


@record
class NominalState:
    jpos: Vec  # rad; insertion m
    jvel: Vec  # rad/s; insertion m/s
    integral: Scalar  # m s, of the insertion's error
    target: TargetState


@record
class NominalOutput:
    jpos: Vec  # rad; insertion m
    tip_position: Vec  # m, 3, frame 0 of the arm
    tip_velocity: Vec  # m/s, 3


def params(setup: RavenSetup, parameter_set: str = parameter_sets.DEFAULT) -> NominalParams:
    """Return the default parameters for a robot of that set, one of `parameter_sets.Name`."""
    # The published sets differ as robots of one kind do, so they have the same nominal model.
    shared_set = "traj3" if parameter_set in parameter_sets.PUBLISHED else parameter_set
    values = parameter_sets.parameter_set(shared_set)
    # As in the software, the first arm's tool limits the joints of every arm.
    allowed = limits.soft_limits(setup.tools[0], setup.software)
    motor = values.actuators
    gain = motor.torque_per_count / transmission.TORQUE_PER_COUNT * motor.gain
    reaction_share, ratio = motor.reaction_scale, transmission.TR
    square = ratio.map(lambda r: r**2)
    link_inertia = *INERTIA[:COUPLED_JOINTS], 0.0, 0.0
    # With rigid cables, a motor turns by r q and obeys J r q'' = -KP gain r q - viscous r q' -
    # coulomb sign(q'). Times I / (J r), this is the equation of a joint of inertia I in the model.
    # J: inertia at the motor, with the link's share.
    inertia_ratio = Vec(INERTIA) / (motor.inertia + reaction_share * link_inertia / square)
    gains = stored.GAINS["raven2"]["gold"]
    kp, kd = (inertia_ratio * Vec(gains[name]) * gain for name in ("kp", "kd"))
    kv = inertia_ratio * (motor.viscous + reaction_share * values.link_viscous / square)
    kc = inertia_ratio * (motor.coulomb + reaction_share * values.link_coulomb / ratio) / ratio
    # A jaw is a double integrator without friction, so its kd contains the viscous friction.
    jaw_friction = Vec((*Vec.full(COUPLED_JOINTS, 0.0), *kv[COUPLED_JOINTS:]))
    return NominalParams(
        kp=kp,
        kd=kd + jaw_friction,
        ki=INTEGRAL_RATE * kp[INSERTION],
        kv=Vec(kv[:COUPLED_JOINTS]),
        kc=Vec(kc[:COUPLED_JOINTS]),
        mass_scale=1.0,
        resync=np.int32(0),
        target=TargetParams(Vec(allowed.lower[:5]), Vec(allowed.upper[:5])),
    )


def init(setup: RavenSetup, arm: ArmName, jpos0: Vec) -> NominalState:
    """Return the state at rest at `jpos0` (rad, m), which is also its target."""
    jpos, still = cast_to_real(setup, (jpos0, Vec.full(7, 0.0)))
    return NominalState(jpos, still, still[0], init_target(arm, jpos))


def step(
    setup, arm: ArmName, params: NominalParams, state: NominalState, command: Command, measured: Vec
) -> tuple[NominalState, NominalOutput]:
    """Compute one tick (1 ms). While the pedal is up, the model stands still.

    measured: joints that the control software measures (rad, m). The measured pose is a little
    below the desired pose, because of gravity. Each time the pedal is lifted, the measured pose
    becomes the robot's desired pose, so the robot sinks. With `params.resync` the model follows the
    robot while the pedal is up, and clutching causes no distance between them.
    """
    follows_robot = (params.resync != 0) & (command.engaged == 0)
    state = replace(state, jpos=where(follows_robot, measured, state.jpos))
    target = step_target(setup, arm, params.target, state.target, command, state.jpos)
    tracking = replace(track_target(arm, params, state, target.jpos_d), target=target)
    at_rest = replace(state, jvel=state.jvel * 0.0, target=target)
    state = where(command.engaged != 0, tracking, at_rest)
    # The target keeps its types, which are integers in part.
    state = replace(cast_to_real(setup, replace(state, target=None)), target=state.target)
    return state, NominalOutput(
        jpos=state.jpos,
        tip_position=kinematics.forward_pose(arm, state.jpos).position,
        tip_velocity=kinematics.tip_velocity(arm, state.jpos, state.jvel),
    )


def track_target(
    arm: ArmName, params: NominalParams, state: NominalState, jpos_d: Vec
) -> NominalState:
    """Return the state after one linearly implicit step (1 ms) toward joints `jpos_d` (rad, m)."""
    dt = TICK_S
    jpos, jvel = state.jpos, state.jvel
    error = jpos_d - jpos
    integral = state.integral + dt * error[INSERTION]
    # Jaws are locked at their home angles, because their few grams hardly move the centre of mass.
    locked = Vec((*jpos[:COUPLED_JOINTS], *limits.HOME_JPOS[COUPLED_JOINTS:]))
    link_speeds = Vec((*jvel[:COUPLED_JOINTS], 0.0, 0.0))
    # G(q) of the controller cancels G(q) of the model exactly, so both are left out.
    mass, bias = link_dynamics.mass_matrix_and_bias(
        arm, locked, link_speeds, Vec.full(3, 0.0), params.mass_scale
    )
    # Lower triangle and right side of the equations of joints 1-5 for the changes dv of speeds: M
    # dv / dt = kp (error - dt (v + dv)) - bias - (kd + kv + friction) (v + dv)
    system, right = [], []
    for i in range(COUPLED_JOINTS):
        row = [mul(1.0 / dt, mass[i][j]) for j in range(i + 1)]
        damping = params.kd[i] + params.kv[i] + dt * params.kp[i]
        row[i] = row[i] + damping
        force = params.kp[i] * error[i] - damping * jvel[i] - bias[i]
        if i == INSERTION:
            force = force + params.ki * integral
        friction = coulomb_damping(params.kc[i], row[i] * jvel[i] + force, row[i])
        row[i] = row[i] + friction
        right.append(force - friction * jvel[i])
        system.append(Vec(row))
    speed_gains = list(solve_spd(tuple(system), Vec(right)))
    for i in range(COUPLED_JOINTS, 7):
        damping = params.kd[i] + dt * params.kp[i]
        speed_gains.append((params.kp[i] * error[i] - damping * jvel[i]) / (1.0 / dt + damping))
    jvel = jvel + Vec(speed_gains)
    return replace(state, jpos=jpos + jvel * dt, jvel=jvel, integral=integral)


def init_target(arm: ArmName, jpos: Vec) -> TargetState:
    """Return the target whose pose is that of the joints `jpos`."""
    pose = kinematics.forward_pose(arm, jpos)
    return TargetState(
        position_um=pose.position.map(lambda p: to_int32(p * UM_PER_M)),
        quat=mapping.quat_from_matrix(pose.rotation),
        grasp_mrad=to_int32((jpos[5] + jpos[6]) * 1000.0),  # opening: grasp1 + grasp2
        jpos_d=jpos,
    )


def step_target(
    setup, arm: ArmName, params: TargetParams, state: TargetState, command: Command, jpos: Vec
) -> TargetState:
    """Return the target after the command of one tick. jpos: joints of the model, rad and m."""
    engaged = command.engaged != 0
    position_um, quat, grasp_mrad = _commanded_pose(setup, arm, state, command)
    pose = kinematics.Pose(
        position=position_um.map(lambda p: p.astype(setup.precision.real) / UM_PER_M),
        rotation=mapping.matrix_from_quat(quat),
    )
    grasp_rad = grasp_mrad.astype(setup.precision.real) / 1000.0
    solution = kinematics.inverse_joints(arm, pose, grasp_rad, jpos)
    clamped_jpos, at_limit = _clamp(setup, params, solution.jpos, solution.yaw)
    reachable = solution.status != kinematics.REJECTED
    # If the pose has no solution, the desired joints remain. While the pedal is up, they are those
    # of the model, which stands still.
    jpos_d = where(engaged & reachable, clamped_jpos, where(engaged, state.jpos_d, jpos))
    target = TargetState(position_um, quat, grasp_mrad, jpos_d)
    opening = where(engaged, grasp_mrad, state.grasp_mrad)
    # At a limit and while the pedal is up, the desired pose becomes that of the desired joints.
    at_joints = replace(init_target(arm, jpos_d), grasp_mrad=opening)
    return where(~engaged | (reachable & at_limit), at_joints, target)


def _commanded_pose(
    setup: RavenSetup, arm: ArmName, state: TargetState, command: Command
) -> tuple[Vec, Vec, Scalar]:
    # Returns position (um), orientation and jaw opening (mrad) that the operator commands.
    if setup.console == "absolute":
        return command.delta_um, command.quat, command.grasp_mrad
    # Increments that close the jaws are positive. The bounds are those of the opening, mrad.
    gain, lowest, highest = stored.jaw_commands(setup.software)
    position_um = state.position_um + mapping.position_from_itp(arm, command.delta_um)
    quat = mapping.quat_mul(mapping.quat_from_itp(arm, command.quat), state.quat)
    square = dot(quat, quat)
    grasp = clamp(state.grasp_mrad - gain * command.grasp_mrad, lowest, highest)
    # The quaternion is divided by its length: near 1, 1 / sqrt(square) is 1.5 - 0.5 square.
    return position_um, quat * (1.5 - 0.5 * square), as_int(grasp)


def _clamp(setup: RavenSetup, params: TargetParams, jpos: Vec, yaw: Scalar) -> tuple[Vec, Scalar]:
    """Return the joints with joints 1-5 clamped to their limits, and whether one of these joints,
    or the yaw of the jaws (rad), is at or beyond a limit. Jaws are not clamped.
    """
    angles, at_limit = list(jpos), False
    for i, (low, high) in enumerate(zip(params.lower, params.upper, strict=True)):
        at_limit = at_limit | (jpos[i] <= low) | (jpos[i] >= high)
        angles[i] = clamp(jpos[i], low, high)
    lowest_yaw = limits.soft_limits(setup.tools[0], setup.software).lower[5]
    if lowest_yaw is not None:
        at_limit = at_limit | (yaw <= lowest_yaw)
    return Vec(angles), at_limit
