"""One cycle of the control software: the order of its stages (raven2: rt_process_preempt.cpp)."""

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ravenjax.numbers import for_each_arm, jnp, narrow_numbers
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, replace
from ravenjax.parts import part
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.geometry.limits import HOME_JPOS
from ravenjax.robots.raven2.geometry.stored_pose import StoredPose
from ravenjax.robots.raven2.loop import user_files
from ravenjax.robots.raven2.setup import PerArm, RavenSetup, map_arms
from ravenjax.robots.raven2.stages import (
    cartesian_control,
    dac,
    estimator,
    motor_control,
    network,
    overdrive,
    state_machine,
    teleoperation,
    usb,
    watchdog,
)

Inject = Callable[..., Any]
"""Function (site, signal, present) -> signal after faults, see `faults.injection.Injector`."""


@record
class ControlParams:
    """Control-software parameters that a campaign may vary. Tuples have one entry per arm."""

    teleoperation: teleoperation.TeleoperationParams
    state_machine: state_machine.StateMachineParams
    estimator: PerArm[estimator.EstimatorParams]
    cartesian: cartesian_control.CartesianParams
    motor_control: PerArm[motor_control.MotorControlParams]
    overdrive: overdrive.OverdriveParams
    own: Any = None  # parameters of the users' files that replace stages, by stage


@record
class ControlState:
    """The control software's state from one cycle to the next."""

    tick: Scalar  # int32, cycles since the start
    network: network.NetworkState
    teleoperation: teleoperation.TeleoperationState
    usb: usb.UsbIn
    state_machine: state_machine.StateMachineState
    estimator: PerArm[estimator.EstimatorState]
    cartesian: cartesian_control.State
    motor_control: PerArm[motor_control.MotorControlState]
    held_cmd: PerArm[Vec]  # int32 DAC counts last written, in the 2015 fork; () in raven2
    overdrive: overdrive.OverdriveState
    watchdog: Scalar  # int32, cycles of the watchdog's wave; also counts while the wave is off


@record
class Inputs:
    """Inputs of the control computer in a cycle. Tuples have one entry per arm and USB board."""

    packet: Packet
    usb: usb.UsbIn
    read_ok: PerArm[Scalar]  # int32, 0: the read from the board failed
    simulated: PerArm[tuple[Vec, Vec]] = ()  # motors 1-3 in a dynamics-simulator build, rad, rad/s


@record
class ArmSignals:
    """Signals of one arm of the control software in one cycle."""

    enc_val: Vec  # 7 int32 counts, as the software uses them
    mpos: Vec  # 7 rad
    mvel: Vec  # 7 rad/s
    jpos: Vec  # 7, rad and m
    jvel: Vec  # 7, rad/s and m/s; tool joints 0, as in the original
    pos: StoredPose
    pos_d: StoredPose
    jpos_d: Vec  # 7, rad and m
    mpos_d: Vec  # 7 rad
    tau_g: Vec  # 3 N m at the capstan
    tau_d: Vec  # 7 N m at the capstan
    current_cmd: Vec  # 7 int32 DAC counts, before the overdrive check
    current_cmd_checked: Vec  # 7 int32 DAC counts, after the overdrive check
    current_cmd_written: Vec  # 7 int32 DAC counts, as written to USB


@record
class ControlSignals:
    """Signals at the seams of the control software in one cycle."""

    arms: PerArm[ArmSignals]
    tick: Scalar  # int32
    runlevel: Scalar  # int32
    sublevel: Scalar  # int32
    surgeon_mode: Scalar  # int32
    last_seq: Scalar  # int32
    initialized: Scalar  # int32 flag
    soft_estopped: Scalar  # int32 flag
    overdrive: Scalar  # int32 flag: the check raised the soft E-stop in this cycle
    clamped: Scalar  # int32 flag: a joint limit clamped a target
    pins_out: Scalar  # int32 output byte to the PLC
    packet: Packet | None = None  # after faults, before the checks; only with Setup.explained


def params(setup: RavenSetup) -> ControlParams:
    """Return the default parameters: the values of the original software."""
    files = tuple(source for _, source in setup.controller)
    return ControlParams(
        teleoperation.params(setup),
        state_machine.params(setup),
        for_each_arm(setup, estimator.params()),
        cartesian_control.params(setup),
        map_arms(setup, motor_control.params),
        overdrive.params(setup),
        part.part_parameters(files) if files else None,
    )


def init(
    setup: RavenSetup, jpos: PerArm[Vec] | None = None, runlevel: int | None = None
) -> ControlState:
    """Return the state of the control software of a homed robot at rest. jpos: joints of each arm,
    rad and m; default: home pose. runlevel: default 0, E-stop, in which raven2 waits for the PLC.
    The 2015 fork starts in pedal-down (3), because its simulator builds have no PLC.
    """
    rest = jpos or for_each_arm(setup, HOME_JPOS)
    if runlevel is None:
        runlevel = run_levels.E_STOP if setup.software == "raven2" else run_levels.PEDAL_DOWN
    cartesian = cartesian_control.init(setup, rest)
    read = usb.init(setup)
    return ControlState(
        tick=np.int32(0),
        network=network.init(setup),
        teleoperation=teleoperation.init(setup, tuple(arm.pos_d for arm in cartesian)),
        usb=read,
        state_machine=state_machine.init(setup, runlevel),
        estimator=for_each_arm(setup, estimator.init(setup)),
        cartesian=cartesian,
        motor_control=map_arms(setup, motor_control.init, setup.tools, rest),
        # The first commands are zeros, as are the encoder counts before the first read.
        held_cmd=read.enc_val if setup.software == "fork2015" else (),
        overdrive=overdrive.init(setup),
        watchdog=np.int32(0),
    )


def receive_packet(
    setup: RavenSetup, params: ControlParams, state: ControlState, packet: Packet
) -> ControlState:
    """Return the state after one datagram (or none). The original has a network thread for this."""
    net, accepted = network.step(setup, state.network, state.tick, packet)
    teleop = teleoperation.accumulate_increments(
        setup, params.teleoperation, state.teleoperation, accepted, packet
    )
    return replace(state, network=net, teleoperation=teleop)


def control_cycle(
    setup: RavenSetup,
    params: ControlParams,
    state: ControlState,
    inputs: Inputs,
    inject: Inject = lambda site, signal, present=True: signal,
    files: user_files.UserFiles | None = None,
) -> tuple[ControlState, ControlSignals]:
    """Return state and signals after a 1 ms cycle of the control software.

    The cycle receives a packet, reads from USB, decides, checks and writes. inject: changes the
    signals at fault sites; default: no faults. files: checks and stages that are users' files.
    Source: raven2 rt_process_preempt.cpp.
    """
    tools, files = setup.tools, files or user_files.UserFiles(setup)
    received = inputs.packet.received != 0
    packet = inject("packet_header", inject("packet", inputs.packet, received), received)
    files.note(runlevel=state.state_machine.runlevel)
    packet = files.check_packet(packet)
    state = receive_packet(setup, params, state, packet)
    tick = state.tick

    # --- sense ---
    read = inject("usb_in", usb.transfer_values(state.usb, inputs.usb, inputs.read_ok))
    desired = inject(
        "runlevel",
        state_machine.desired_runlevel(params.state_machine, state.state_machine, read.pins),
    )
    machine = state_machine.adopt_level(state.state_machine, tick, desired)
    level = machine.runlevel
    pedal_down = level == run_levels.PEDAL_DOWN
    active = level >= run_levels.PEDAL_UP

    teleop, poses_d = teleoperation.hand_over(
        setup,
        params.teleoperation,
        state.teleoperation,
        tick,
        pedal_down,
        tuple(arm.pos_d for arm in state.cartesian),
    )
    cartesian = replace_fields(state.cartesian, pos_d=poses_d)
    machine, following = state_machine.advance_sublevel(setup, machine)
    cartesian = cartesian_control.follow_measured(cartesian, following)

    estimates, mpos, mvel = zip(
        *map_arms(setup, estimator.step, tools, params.estimator, state.estimator, read.enc_val),
        strict=True,
    )
    if inputs.simulated:
        mpos, mvel = _simulated_motors(setup, inputs, state, mpos, mvel)
    mpos = inject("mpos", mpos)
    mvel = inject("mvel", mvel)
    files.note(runlevel=level, enc_val=read.enc_val, mvel=mvel)
    mpos = files.check("mpos", mpos)
    jpos = inject("jpos", map_arms(setup, estimator.joint_positions, tools, mpos))
    jvel = inject("jvel", tuple(map(partial(estimator.joint_velocities, setup), mvel)))
    files.note(jvel=jvel)
    jpos = files.check("jpos", jpos)

    # --- decide ---
    follows_robot = (level != run_levels.PEDAL_DOWN) & (level != run_levels.INIT)
    poses = map_arms(setup, cartesian_control.measure_pose, jpos)
    poses = _inject_poses(inject, ("pos", "ori"), poses)
    cartesian = cartesian_control.follow_measured(
        replace_fields(cartesian, pos=poses), follows_robot
    )
    poses_d = _inject_poses(inject, ("pos_d", "ori_d"), tuple(arm.pos_d for arm in cartesian))
    cartesian = replace_fields(cartesian, pos_d=poses_d)
    cartesian, clamped = cartesian_control.solve_inverse(
        setup, params.cartesian, cartesian, tick, active, jpos
    )
    teleop = teleoperation.reset_origin(
        setup, teleop, follows_robot | following | clamped, tuple(arm.pos_d for arm in cartesian)
    )
    jpos_d = inject("jpos_d", tuple(arm.jpos_d for arm in cartesian))
    files.note(
        pos=tuple(arm.pos.position_um for arm in cartesian),
        pos_d=tuple(arm.pos_d.position_um for arm in cartesian),
    )
    jpos_d = files.check("jpos_d", jpos_d)
    cartesian = replace_fields(cartesian, jpos_d=jpos_d)

    mpos_d = inject("mpos_d", map_arms(setup, motor_control.motor_targets, tools, jpos_d, mpos))
    if files.replaces(user_files.MOTOR_CONTROL):
        motors = files.step_motor_control(
            params.motor_control, state.motor_control, active, pedal_down, mpos_d, jpos
        )
    else:
        compute_torques = partial(motor_control.motor_torques, active=active, pedal_down=pedal_down)
        arms = params.motor_control, state.motor_control
        motors = map_arms(setup, compute_torques, *arms, mpos_d, jpos, mpos, mvel)
    files.note(mpos_d=tuple(motor.mpos_d for motor in motors))
    tau_d = files.check("tau_d", inject("tau_d", tuple(motor.tau_d for motor in motors)))
    motors = replace_fields(motors, tau_d=tau_d)
    # An inactive arm gets the command 0, or in simulator builds of the fork its last command
    without_command = for_each_arm(setup, Vec.full(7, 0))
    if state.held_cmd:
        keep = ~active & (params.state_machine.plc_obeyed == 0)
        without_command = tuple(cmd.map(lambda x: jnp.where(keep, x, 0)) for cmd in state.held_cmd)
    live = files.allow(active & (machine.soft_estopped == 0))
    if files.replaces(user_files.DAC):
        commands = files.step_dac(live, without_command)
    else:
        commands = map_arms(setup, partial(dac.step, enabled=live), tools, tau_d, without_command)
    current_cmd = files.check("current_cmd", inject("current_cmd", commands))

    # --- check ---
    over, checked, tripped = overdrive.step(
        setup, params.overdrive, state.overdrive, tick, level, current_cmd
    )
    checked = files.check("checked_cmd", checked)
    machine = state_machine.raise_soft_estop(machine, tick, files.stop(tripped))
    wave, pins = watchdog.step(
        state.watchdog, machine.soft_estopped, level, teleop.surgeon_mode, machine.initialized
    )

    # --- write ---
    written = inject("usb_out", checked)
    pins = inject("pins_out", pins)

    signals = ControlSignals(
        arms=tuple(
            ArmSignals(**row)
            for row in rows_of(
                enc_val=read.enc_val,
                mpos=mpos,
                mvel=mvel,
                jpos=jpos,
                jvel=jvel,
                **columns_of(cartesian, "pos", "pos_d"),
                **columns_of(motors, "mpos_d", "tau_g"),
                jpos_d=jpos_d,
                tau_d=tau_d,
                current_cmd=current_cmd,
                current_cmd_checked=checked,
                current_cmd_written=written,
            )
        ),
        tick=tick,
        runlevel=level,
        sublevel=machine.sublevel,
        surgeon_mode=teleop.surgeon_mode,
        last_seq=teleop.last_seq,
        initialized=machine.initialized,
        soft_estopped=machine.soft_estopped,
        overdrive=as_int(tripped),
        clamped=as_int(clamped),
        pins_out=pins,
        packet=packet if setup.explained else None,
    )
    state = ControlState(
        tick=tick + 1,
        network=state.network,
        teleoperation=teleop,
        usb=read,
        state_machine=machine,
        estimator=estimates,
        cartesian=cartesian,
        motor_control=motors,
        held_cmd=written if setup.software == "fork2015" else (),
        overdrive=over,
        watchdog=wave,
    )
    return state, signals


def rows_of(**columns: tuple[Any, ...]) -> list[dict[str, Any]]:
    """Return the fields of each arm. columns: name of a field -> its values, one per arm."""
    return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]


def columns_of(records: tuple[Any, ...], *names: str) -> dict[str, tuple[Any, ...]]:
    """Return name -> values of this field in the records, one per arm."""
    return {name: tuple(getattr(record, name) for record in records) for name in names}


def replace_fields(records: tuple[Any, ...], **columns: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the arms' records with new values. columns: field -> its new values, one per arm."""
    return tuple(replace(old, **row) for old, row in zip(records, rows_of(**columns), strict=True))


def _inject_poses(
    inject: Inject, sites: tuple[str, str], poses: PerArm[StoredPose]
) -> PerArm[StoredPose]:
    """Return poses after faults. sites: fault site of the position, and of the rotation."""
    position, rotation = sites
    return replace_fields(
        poses,
        position_um=inject(position, tuple(pose.position_um for pose in poses)),
        rotation=inject(rotation, tuple(pose.rotation for pose in poses)),
    )


def _simulated_motors(
    setup: RavenSetup, inputs: Inputs, state: ControlState, mpos: PerArm[Vec], mvel: PerArm[Vec]
) -> tuple[PerArm[Vec], PerArm[Vec]]:
    # Returns motor positions and velocities for the 2015 fork's simulator builds, which read motors
    # 1-3 from a simulation. The build dyn_sim_tools reads the tool motors as measured. In the build
    # dyn_sim, the tool motors rest at their last desired positions.
    tool_mpos, tool_mvel = mpos, mvel
    if setup.build == "dyn_sim":
        tool_mpos = tuple(motors.mpos_d for motors in state.motor_control)
        tool_mvel = for_each_arm(setup, Vec.full(7, narrow_numbers(setup, 0.0)))
    positions, velocities = [], []
    for simulated, arm_mpos, arm_mvel in zip(inputs.simulated, tool_mpos, tool_mvel, strict=True):
        # Motors 1-3 from the simulation, the four tool motors from `tool_mpos` and `tool_mvel`
        mpos_1_to_3, mvel_1_to_3 = simulated
        positions.append(Vec((*narrow_numbers(setup, mpos_1_to_3), *arm_mpos[3:])))
        velocities.append(Vec((*narrow_numbers(setup, mvel_1_to_3), *arm_mvel[3:])))
    return tuple(positions), tuple(velocities)
