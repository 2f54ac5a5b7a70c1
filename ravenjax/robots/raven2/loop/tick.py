"""One millisecond of everything, on one page: console, network, control software, PLC, robot,
nominal model, cue.

The order is the robot's own: sense, decide, check, write; the plant moves last and its encoders are
read in the next tick. Faults strike at the sites named here and in `control`. The nominal model
runs beside the robot on the *clean* operator input; the monitor compares it with the robot and the
console's haptic device pulls.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ravenjax.faults import fault
from ravenjax.numbers import finite
from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.setup import per_arm, real
from ravenjax.numbers.vec import Scalar, Vec, as_int, replace, where
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.console import operator, own_operator, reaction
from ravenjax.robots.raven2.geometry.mapping import position_to_itp
from ravenjax.robots.raven2.loop import connections, control, observers
from ravenjax.robots.raven2.loop.injector import RavenInjector, seeded
from ravenjax.robots.raven2.loop.records import Input, TickParams, TickSignals, TickState
from ravenjax.robots.raven2.loop.user_files import UserFiles
from ravenjax.robots.raven2.loop.watchers import Sight, find_watchers
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import plc, usb
from ravenjax.stages import channel, detectors, hand, packet_clock, packet_history


def tick(
    setup: RavenSetup, params: TickParams, faults: fault.Faults, state: TickState, signal: Input
) -> tuple[TickState, TickSignals]:
    """One millisecond of one robot."""
    now = signal.tick
    fresh, sequence, clock = _packet_due(setup, params, state, signal)
    history = None if state.history is None else packet_history.step(state.history, fresh)
    triggers = fault.TriggerClocks(now, sequence + 1, state.pedal_ticks)
    inject = RavenInjector(
        setup, faults, fault.open_windows(setup, faults, state.faults, triggers), triggers
    )
    files = UserFiles(setup, params.checks, params.control.own, state.files, now)

    state = replace(state, clock=clock, history=history)
    state, clean, packet, arrives = _send_packet(
        setup, params, inject, state, signal, fresh, sequence
    )
    state, software, relays, robots = _move_robot(setup, params, inject, state, packet, files)
    before = observers.ObserverState(state.nominal, state.haptics, state.monitor)
    robot = observers.RobotView(
        jpos=tuple(arm.jpos for arm in software.arms),
        mvel=tuple(arm.mvel for arm in software.arms),
        runlevel=software.runlevel,
        soft_estopped=state.control.state_machine.soft_estopped,
        dac=state.boards.current_cmd,
        pos=tuple(arm.pos.position_um for arm in software.arms),
        tips=connections.tips(setup, params.plant, state.plant, robots),
    )
    look = observers.Look(setup, params.observers, before, clean, fresh, robot)
    seen = look.seen
    signals = TickSignals(
        packet=packet,
        control=software,
        plant=robots,
        boards=state.boards.current_cmd,
        plc=relays,
        nominal=seen.models,
        haptics=seen.cues,
        tip=seen.tips,
        depth=seen.depth,
        tip_distance=seen.distance,
        fault_active=tuple(slot.active for slot in inject.state.slots),
    )
    sight = Sight(now, seen.live, signals, files)

    def watch(early: bool) -> dict[str, Any]:
        return {
            name: watcher.step(setup, params, state.watchers[name], sight)
            for name, watcher in find_watchers(setup).items()
            if watcher.early == early
        }

    watched = watch(early=True)
    monitor = look.judge(observers.Golden(signal.reference, signal.apart), now)
    down = software.runlevel == run_levels.PEDAL_DOWN
    state = _move_hands(setup, params, state, signals, fresh, down, now)
    watched |= watch(early=False)
    numbers = {"joint": [x for out in robots for x in (*out.jpos, *out.mpos)]}
    for name, watcher in find_watchers(setup).items():
        numbers |= watcher.numbers(watched[name])
    if state.hands is not None:
        numbers["hand"] = [x for offset in state.hands.offset for x in offset]
    if state.own_operator is not None and state.own_operator.grasp is not None:
        numbers["hand"] = [*numbers.get("hand", ()), *state.own_operator.grasp.offset]
    state = replace(
        state,
        faults=inject.state,
        nominal=look.state.nominal,
        haptics=look.state.haptics,
        files=files.state,
        watchers=watched,
        pedal_ticks=jnp.where(down, jnp.maximum(state.pedal_ticks, -1) + 1, -1),
        pedal_down_ticks=state.pedal_down_ticks + as_int(seen.live),
        packet=sequence,
        delivered=jnp.where(arrives, packet.sequence - 1, state.delivered),
        monitor=replace(monitor, finite=finite.step(monitor.finite, numbers, now)),
    )
    return state, signals


def _packet_due(
    setup: RavenSetup, params: TickParams, state: TickState, signal: Input
) -> tuple[Scalar, Scalar, packet_clock.PacketClock | None]:
    """Whether there is a new packet in this tick, the index of the newest one, and the clock
    after it.
    """
    if signal.packet is not None:
        fresh = signal.packet.received != 0
        return fresh, state.packet + as_int(fresh), state.clock
    now, cycles = signal.tick, params.network.cycles_per_packet
    stopped = state.control.state_machine.soft_estopped
    # a simulator's packet generator ends with the robot's software E-stop
    ends = setup.build != "robot"
    if state.clock is not None:
        fresh = now >= state.clock.due
        fresh = fresh & (stopped == 0) if ends else fresh
        index = state.packet + as_int(fresh)
        network = params.network
        lasts = packet_clock.length(setup.packets, network.packets, network.packet_key, index)
        return fresh, index, packet_clock.step(state.clock, now, fresh, lasts)
    every_tick = isinstance(cycles, np.integer) and cycles == 1
    index = now if every_tick else lax.div(now, jnp.maximum(cycles, 1))
    if ends:
        index = jnp.where(stopped != 0, state.packet, index)
    elif every_tick:
        return jnp.bool_(True), now, None
    return index != state.packet, index, None


def _send_packet(
    setup: RavenSetup,
    params: TickParams,
    inject: RavenInjector,
    state: TickState,
    signal: Input,
    fresh: Scalar,
    sequence: Scalar,
) -> tuple[TickState, Any, Any, Scalar]:
    """Console and network: the state, the packet as the console meant it, which the nominal model
    follows, the packet as it reaches the robot, and whether it does.
    """
    now, clock, history = signal.tick, state.clock, state.history
    hands, own, deviation = state.hands, state.own_operator, own_operator.PLAN
    timing, moment = connections.row_by_row(sequence), (sequence, sequence - 1, fresh)
    if clock is not None:
        timing = connections.PacketTiming(sequence, clock.tick, clock.before)
        moment = now, now - 1, jnp.bool_(True)
    reacting = state.reaction
    if params.reaction is not None:
        reacting = reaction.act(setup, params.reaction, reacting, now, timing.row)
    if own is not None and signal.packet is None:
        own, hands, deviation = own_operator.act(
            setup,
            params.operator,
            own,
            hands,
            signal.motion,
            own_operator.PlanMoment(*moment),
            fresh,
            now,
        )
    if hands is not None and inject.strikes("hand"):
        still = connections.each(setup, Vec.full(3, real(setup, 0.0)))
        hands = operator.strayed(hands, inject("hand", still))

    def made(console: operator.OperatorParams, timing: connections.PacketTiming) -> Any:
        return connections.packet(
            setup, console, params.reaction, signal.motion, reacting, hands, timing, deviation
        )

    clean = made(params.operator, timing) if signal.packet is None else signal.packet
    console = inject("console", connections.ConsoleSeam(params.operator.scale))

    network = inject(
        "network",
        connections.Network(
            jnp.int32(0), jnp.int32(0), jnp.bool_(False), real(setup, 0.0), real(setup, 0.0)
        ),
    )
    line = state.channel
    if line is not None:
        line = channel.step(line, network.bursts, sequence, fresh)
        network = replace(network, lost=network.lost | (line.burst > 0))
    if seeded(setup, "jitter"):
        late = channel.delay_ms(network.jitter, sequence)
        if history is not None:
            late = packet_history.sent_within(history, late)
        else:
            cycles = jnp.maximum(params.network.cycles_per_packet, 1)
            late = lax.div(late + cycles - 1, cycles)
        network = replace(network, delay=network.delay + late)

    # a packet from outside is not there to be sent again
    packet, again = clean, signal.packet is None
    if again and inject.strikes("console", "network"):
        if clock is None:
            timing = connections.row_by_row(sequence - network.lag - network.delay)
        elif history is not None:
            # the packet so many before the newest was made when it was sent
            older = jnp.maximum(network.lag + network.delay, 0)
            row, before = (now - packet_history.age(history, n) for n in (older, older + 1))
            timing = connections.PacketTiming(sequence - older, row, before)
        packet = made(replace(params.operator, scale=console.scale), timing)
    arrives = fresh & ~network.lost
    if again and inject.strikes("network"):
        index = packet.sequence - 1
        arrives = arrives & (index >= 0) & ((network.delay == 0) | (index > state.delivered))
    state = replace(
        state,
        hands=hands,
        reaction=reacting,
        own_operator=own,
        channel=line,
    )
    return state, clean, replace(packet, received=as_int(arrives)), arrives


def _move_robot(
    setup: RavenSetup,
    params: TickParams,
    inject: RavenInjector,
    state: TickState,
    packet: Any,
    files: UserFiles,
) -> tuple[TickState, control.ControlSignals, plc.PlcOutput, tuple[plant.PlantOutput, ...]]:
    """Control computer and PLC; then motors, cables and links."""
    fine = connections.each(setup, jnp.int32(1))
    status = inject("usb_status", connections.UsbStatus(fine, fine))
    pins = plc.input_pins(inject("plc", state.plc.runlevel))
    delivered = usb.UsbIn(inject("encoder", state.enc_val), connections.each(setup, pins))
    inputs = control.Inputs(packet, delivered, status.read_ok, state.motors)
    software, signals = control.cycle(setup, params.control, state.control, inputs, inject, files)
    message = usb.UsbOut(
        tuple(arm.current_cmd_written for arm in signals.arms),
        connections.each(setup, signals.pins_out),
    )
    files.note(boards_enc_val=delivered.enc_val, current_cmd_written=message.current_cmd)
    boards = usb.transfer(state.boards, message, status.write_ok)
    boards = files.check_boards(state.boards, boards, state.plc.runlevel)

    pressed = detectors.stops(setup, state.watchers.get("detectors"))
    buttons = inject("buttons", connections.Buttons(pressed, jnp.bool_(False)))
    plc_signal = plc.PlcSignal(
        boards.pins[: connections.boards_apart(setup)], buttons.estop, buttons.start
    )
    controller, relays = plc.step(setup, params.plc, state.plc, plc_signal)
    # brakes follow the PLC; the simulator builds of the 2015 fork have none
    brakes = inject("brake", relays.brakes if setup.software == "raven2" else jnp.int32(0))
    multipliers = {
        site: inject(site, connections.each(setup, Vec.full(7, neutral)))
        for site, neutral in _MECHANICS.items()
        if inject.strikes(site)
    }
    driven = boards.current_cmd
    for ticks, then in enumerate(state.commands, start=1):
        driven = where(params.usb.command_delay == ticks, then, driven)
    loads = per_arm(setup, lambda i, _: connections.plant_signal(driven[i], brakes, multipliers, i))
    moved = plant.step_all(setup, params.plant, state.plant, loads, params.contact)
    robots = tuple(out for _, out in moved)
    state = replace(
        state,
        control=software,
        boards=boards,
        commands=(boards.current_cmd, *state.commands)[: setup.command_delay],
        plc=controller,
        plant=tuple(new for new, _ in moved),
        enc_val=tuple(out.enc_val for out in robots),
        motors=connections.motors(setup, robots),
    )
    return state, signals, relays, robots


_MECHANICS: dict[str, float] = {
    "torque_scale": 1.0,
    "cable_scale": 1.0,
    "friction_scale": 1.0,
    "external_torque": 0.0,
}
"""Sites of the robot's mechanics, with what they are where nothing is wrong."""


def _move_hands(
    setup: RavenSetup,
    params: TickParams,
    state: TickState,
    signals: TickSignals,
    fresh: Scalar,
    down: Scalar,
    now: Scalar,
) -> TickState:
    """The operator after this tick's cue: what the hands add to their plan from now on."""
    hands, reacting, pulled, own = state.hands, state.reaction, state.hand, state.own_operator
    cues, models = signals.haptics, tuple(out.tip_position for out in signals.nominal)
    if hands is not None:
        off_plan = operator.tip_offset(setup, params.operator, hands)
        hands = operator.sent(hands, fresh)
        if params.reaction is not None:
            pulls = tuple(out.force[0] for out in cues)
            senses = reaction.OperatorSenses(pulls, signals.tip, models, off_plan, down, now)
            reacting, correction = reaction.feel(setup, params.reaction, reacting, senses)
            hands = operator.steered(setup, params.operator, hands, correction)
        yielding = params.hand
        if yielding is not None:
            pulled = per_arm(
                setup,
                lambda i, arm: hand.step(
                    setup,
                    yielding,
                    state.hand[i],
                    position_to_itp(arm, cues[i].direction * cues[i].force[0]),
                ),
            )
            moves = tuple(
                (new.displacement - old.displacement) * 1e6
                for new, old in zip(pulled, state.hand, strict=True)
            )
            hands = operator.strayed(hands, moves)
    if own is not None:
        own = own_operator.see(setup, own, signals.tip, models, cues, signals.control.runlevel)
    return replace(state, hands=hands, reaction=reacting, hand=pulled, own_operator=own)
