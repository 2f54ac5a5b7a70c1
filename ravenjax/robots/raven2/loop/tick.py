"""One millisecond of the whole system: console, network, software, PLC, robot, model, cue.

The order is the robot's: sense, decide, check, write. The plant moves last, and its encoders are
read in the next tick. Optional stages (`optional.STAGES`) act before the console makes its packet,
between console and robot, and after the robot has moved. Faults act at the sites named here and in
`control`. The nominal model runs beside the robot on the *clean* operator input, without faults.
The monitor compares it with the robot, and the console's haptic device renders the cue.
"""

from typing import Any

import numpy as np

from ravenjax.faults import fault
from ravenjax.faults.injection import injects_faults
from ravenjax.numbers import cast_to_real, finite, for_each_arm, jnp, lax
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, replace, where
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.console import operator
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.loop import control, observers, user_files
from ravenjax.robots.raven2.loop.injector import RavenInjector, seeds_network
from ravenjax.robots.raven2.loop.optional import Stage, find_stages
from ravenjax.robots.raven2.loop.records import (
    Console,
    Input,
    Network,
    PlanMoment,
    Sight,
    TickParams,
    TickSignals,
    TickState,
)
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.robots.raven2.setup import PerArm, RavenSetup
from ravenjax.robots.raven2.stages import plc, usb
from ravenjax.stages import channel, detectors


@record
class Buttons:
    """The buttons of the robot; True while pressed."""

    estop: Scalar  # bool
    start: Scalar  # bool


@record
class UsbStatus:
    """Whether USB transfers of each board succeed."""

    read_ok: PerArm[Scalar]  # int32 flag
    write_ok: PerArm[Scalar]  # int32 flag


def advance_tick(
    setup: RavenSetup, params: TickParams, faults: fault.Faults, state: TickState, signal: Input
) -> tuple[TickState, TickSignals]:
    """Compute one millisecond of one robot."""
    now, present, stages = signal.tick, find_stages(setup), dict(state.stages)
    console = _wait_for_packet(setup, params, state, signal)
    for name, stage in present.items():
        stages[name] = stage.act(stages[name], console)
    fresh, sequence = console.fresh, console.sequence
    triggers = fault.TriggerClocks(now, sequence + 1, state.pedal_ticks)
    inject = RavenInjector(
        setup, faults, fault.open_windows(setup, faults, state.faults, triggers), triggers
    )
    params = inject.inject_parameters(params)
    files = user_files.UserFiles(setup, params.checks, params.control.own, state.files, now)
    clean, packet, arrives = _send_packet(setup, params, inject, state, present, stages, console)
    pressed = detectors.detector_stops(setup, stages.get("detectors"))
    state, software, relays, robots = _move_robot(
        setup, params, inject, state, packet, files, pressed
    )
    robot = observers.RobotSignals(
        **control.columns_of(software.arms, "jpos", "mvel"),
        runlevel=software.runlevel,
        soft_estopped=state.control.state_machine.soft_estopped,
        dac=state.boards.current_cmd,
        pos=tuple(arm.pos.position_um for arm in software.arms),
        tips=plant.true_tips(setup, params.plant, state.plant, robots),
    )
    state, observed = observers.update_model_and_cue(setup, params, state, clean, fresh, robot)
    signals = TickSignals(
        packet=packet,
        control=software,
        plant=robots,
        boards=state.boards.current_cmd,
        plc=relays,
        nominal=observed.models,
        haptics=observed.cues,
        tip=observed.tips,
        depth=observed.depth,
        tip_distance=observed.distance,
        fault_active=tuple(slot.active for slot in inject.state.slots),
        live=observed.live,
    )
    down = software.runlevel == run_levels.PEDAL_DOWN
    hands = operator.mark_sent(console.hands, fresh)
    foot = clean.surgeon_mode != 0
    sight = Sight(setup, params, now, down, observed.live, foot, signals, files, hands)

    def watch(early: bool):
        for name, stage in present.items():
            if stage.early == early:
                stages[name] = stage.watch(stages[name], sight)

    watch(early=True)
    monitor = observers.update_monitor(
        setup, params, state.monitor, clean, fresh, robot, observed, signal, now
    )
    watch(early=False)
    # The run fails in the first tick in which one of these numbers is not finite.
    numbers = {"joint": [x for out in robots for x in (*out.jpos, *out.mpos)]}
    for name, stage in present.items():
        numbers |= stage.numbers(stages[name])
    if offsets := [x for offset in sight.hands.offset for x in offset]:
        numbers["hand"] = [*offsets, *numbers.get("hand", ())]
    state = replace(
        state,
        faults=inject.state,
        hands=sight.hands,
        files=files.state,
        stages=stages,
        pedal_ticks=jnp.where(down, jnp.maximum(state.pedal_ticks, -1) + 1, -1),
        pedal_down_ticks=state.pedal_down_ticks + as_int(observed.live),
        packet=sequence,
        delivered=jnp.where(arrives, packet.sequence - 1, state.delivered),
        monitor=replace(monitor, finite=finite.step(monitor.finite, numbers, now)),
    )
    return state, replace(signals, detectors=stages.get("detectors"))


def _wait_for_packet(
    setup: RavenSetup, params: TickParams, state: TickState, signal: Input
) -> Console:
    """Return the console in this tick, which sends a packet every `cycles_per_packet` cycles."""
    now, cycles = signal.tick, params.network.cycles_per_packet
    soft_estopped = state.control.state_machine.soft_estopped
    # The packet generator of a simulator build ends with the robot's software E-stop.
    ends_with_robot = setup.build != "robot"
    if signal.packet is not None:
        fresh = signal.packet.received != 0
        sequence = state.packet + as_int(fresh)
    else:
        # If all runs send a packet in every tick, the compiled tick needs no division.
        every_tick = isinstance(cycles, np.integer) and cycles == 1
        sequence = now if every_tick else lax.div(now, jnp.maximum(cycles, 1))
        if ends_with_robot:
            sequence = jnp.where(soft_estopped != 0, state.packet, sequence)
        # A robot build with a packet in every tick changes the sequence number in every tick.
        always_fresh = every_tick and not ends_with_robot
        fresh = jnp.bool_(True) if always_fresh else sequence != state.packet

    def count_packets(ms: Scalar) -> Scalar:
        # Returns the number of packets sent in `ms` milliseconds, rounded up.
        length = jnp.maximum(cycles, 1)
        return lax.div(ms + length - 1, length)

    return Console(
        setup,
        params,
        signal,
        newest=state.packet,
        soft_estopped=soft_estopped,
        fresh=fresh,
        sequence=sequence,
        timing=operator.row_timing(sequence),
        # Packet k contains row k of the motion.
        plan=PlanMoment(row=sequence, before=sequence - 1, continues=fresh),
        hands=state.hands,
        # The packet that arrives if faults delay packets by this number of packets.
        older=lambda network: operator.row_timing(sequence - network.lag - network.delay),
        packets_in=count_packets,
    )


def _send_packet(
    setup: RavenSetup,
    params: TickParams,
    inject: RavenInjector,
    state: TickState,
    present: dict[str, Stage],
    stages: dict[str, Any],
    console: Console,
) -> tuple[Packet, Packet, Scalar]:
    """Return the packet before faults, the packet at the robot, and whether a packet arrives.
    stages: states of the stages that are `present`; stages between console and robot update them.
    """
    signal, sequence = console.signal, console.sequence
    if inject.injects_at("hand"):
        no_motion = for_each_arm(setup, Vec.full(3, cast_to_real(setup, 0.0)))
        console.hands = operator.add_hand_motion(console.hands, inject("hand", no_motion))

    def make_packet(sender: operator.OperatorParams, timing: operator.PacketTiming) -> Packet:
        return operator.make_packet(
            setup, sender, signal.motion, timing, console.hands, console.deviate(timing)
        )

    clean = make_packet(params.operator, console.timing) if signal.packet is None else signal.packet
    scale = inject("console", params.operator.scale)
    zero, no_seed = jnp.int32(0), cast_to_real(setup, 0.0)
    no_fault = Network(lag=zero, delay=zero, lost=jnp.bool_(False), bursts=no_seed, jitter=no_seed)
    network = inject("network", no_fault)
    for name, stage in present.items():
        stages[name], network = stage.transmit(stages[name], console, network)
    if seeds_network(setup, "jitter"):
        late = console.packets_in(channel.delay_ms(network.jitter, sequence))
        network = replace(network, delay=network.delay + late)
    # A packet from an external console cannot be computed again.
    packet, may_resend = clean, signal.packet is None
    if may_resend and inject.injects_at("console", "network"):
        packet = make_packet(replace(params.operator, scale=scale), console.older(network))
    arrives = console.fresh & ~network.lost
    if may_resend and inject.injects_at("network"):
        # Sequence numbers begin at 1, so a packet with a negative index does not exist. A channel
        # that delays packets delivers them in order, and each of them once.
        index = packet.sequence - 1
        arrives = arrives & (index >= 0) & ((network.delay == 0) | (index > state.delivered))
    return clean, replace(packet, received=as_int(arrives)), arrives


def _move_robot(
    setup, params: TickParams, inject: RavenInjector, state: TickState, packet, files, pressed
) -> tuple[TickState, control.ControlSignals, plc.PlcOutput, PerArm[plant.PlantOutput]]:
    """Compute one tick of control software, PLC and mechanics. pressed: bool, a detector presses
    the E-stop. Returns the state, the signals of the control software, the output of the PLC, and
    the output of each arm's mechanics.
    """
    all_succeed = for_each_arm(setup, jnp.int32(1))
    status = inject("usb_status", UsbStatus(read_ok=all_succeed, write_ok=all_succeed))
    pins = plc.input_pins(inject("plc", state.plc.runlevel))
    delivered = usb.UsbIn(inject("encoder", state.enc_val), for_each_arm(setup, pins))
    inputs = control.Inputs(packet, delivered, status.read_ok, state.motors)
    software, signals = control.control_cycle(
        setup, params.control, state.control, inputs, inject, files
    )
    message = usb.UsbOut(
        tuple(arm.current_cmd_written for arm in signals.arms),
        for_each_arm(setup, signals.pins_out),
    )
    files.note(boards_enc_val=delivered.enc_val, current_cmd_written=message.current_cmd)
    boards = usb.transfer_values(state.boards, message, status.write_ok)
    boards = files.check_boards(state.boards, boards, state.plc.runlevel)
    buttons = inject("buttons", Buttons(pressed, jnp.bool_(False)))
    plc_signal = plc.PlcSignal(boards.pins[: separate_boards(setup)], buttons.estop, buttons.start)
    controller, relays = plc.step(setup, params.plc, state.plc, plc_signal)
    # Brakes follow the PLC. The simulator builds of the 2015 fork have no PLC.
    brakes = inject("brake", relays.brakes if setup.software == "raven2" else jnp.int32(0))
    # Without a fault, the defaults of `PlantSignal` add no operations to the tick.
    mechanical_faults = {
        site: inject(site, for_each_arm(setup, getattr(plant.PlantSignal, site)))
        for site in _MECHANICS
        if inject.injects_at(site)
    }
    commands = boards.current_cmd
    for ticks, earlier in enumerate(state.commands, start=1):
        commands = where(params.usb.command_delay == ticks, earlier, commands)
    rows = control.rows_of(current_cmd=commands, **mechanical_faults)
    plant_signals = tuple(plant.PlantSignal(brakes=brakes, **row) for row in rows)
    moved = plant.step_all(setup, params.plant, state.plant, plant_signals, params.stages)
    robots = tuple(out for _, out in moved)
    state = replace(
        state,
        control=software,
        boards=boards,
        commands=(boards.current_cmd, *state.commands)[: setup.command_delay],
        plc=controller,
        plant=tuple(new for new, _ in moved),
        enc_val=tuple(out.enc_val for out in robots),
        motors=motor_angles(setup, robots),
    )
    return state, signals, relays, robots


def separate_boards(setup: RavenSetup) -> int:
    """Return the number of USB boards whose output pins must be simulated separately.

    All boards get the same pins, so pins differ only if a write can fail, or if a user's check can
    stop a board. Otherwise one board stands for all.
    """
    may_differ = injects_faults(setup, "usb_status") or user_files.boards_may_refuse(setup)
    return len(setup.arms) if may_differ else 1


def motor_angles(setup: RavenSetup, robots: PerArm[plant.PlantOutput]) -> PerArm[tuple[Vec, Vec]]:
    """Return positions (rad) and velocities (rad/s) of motors 1-3 of each arm.

    Dynamics-simulator builds read these numbers. Other builds read encoders, and the result is ().
    """
    if setup.build == "robot":
        return ()
    return tuple((Vec(out.mpos[:3]), Vec(out.mvel[:3])) for out in robots)


_MECHANICS = ("torque_scale", "cable_scale", "friction_scale", "external_torque")
"""Fault sites of the robot's mechanics; `PlantSignal` has their values without a fault."""
