"""One millisecond of everything, on one page: console, network, control software, PLC, robot,
nominal model, cue.

The order is the robot's own: sense, decide, check, write; the plant moves last and its encoders are
read in the next tick. Faults strike at the sites named here and in `control`. The nominal model
runs beside the robot on the *clean* operator input; the monitor compares it with the robot and the
console's haptic device pulls.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ravenjax.faults import fault, window
from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.setup import per_arm, real
from ravenjax.numbers.vec import Scalar, Vec, as_int, replace
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.console import operator, own_operator, reaction
from ravenjax.robots.raven2.geometry.mapping import position_to_itp
from ravenjax.robots.raven2.loop import arm_view, connections, control, failure, observers
from ravenjax.robots.raven2.loop.guard import UNGUARDED, Guard, Unguarded
from ravenjax.robots.raven2.loop.injector import RavenInjector, seeded
from ravenjax.robots.raven2.loop.records import Input, TickParams, TickSignals, TickState
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import plc, usb
from ravenjax.stages import (
    channel,
    detectors,
    hand,
    haptics,
    overload,
    packet_clock,
    packet_history,
    touch,
)


def tick(
    setup: RavenSetup, params: TickParams, faults: fault.Faults, state: TickState, signal: Input
) -> tuple[TickState, TickSignals]:
    """One millisecond of one robot."""
    now = signal.tick
    fresh, sequence, clock = _packet_due(setup, params, state, signal)
    history = None if state.history is None else packet_history.step(state.history, fresh)
    triggers = window.TriggerClocks(now, sequence + 1, state.pedal_ticks)
    inject = RavenInjector(
        setup, faults, window.open_windows(setup, faults, state.faults, triggers), triggers
    )

    due = replace(state, clock=clock, history=history)
    sent = _console_and_network(setup, params, inject, due, signal, fresh, sequence)
    lookout = UNGUARDED
    if params.checks is not None and state.guard is not None:
        lookout = Guard(setup, params.checks, state.guard, now)
    done = _robot(setup, params, inject, state, sent.packet, lookout)
    signals, robots = done.signals, done.robots
    before = observers.ObserverState(state.nominal, state.haptics, state.monitor)
    robot = observers.RobotView(
        jpos=tuple(arm.jpos for arm in signals.arms),
        mvel=tuple(arm.mvel for arm in signals.arms),
        runlevel=signals.runlevel,
        soft_estopped=done.software.state_machine.soft_estopped,
        dac=done.boards.current_cmd,
        pos=tuple(arm.pos.position_um for arm in signals.arms),
        tips=connections.tips(setup, params.plant, done.plant, robots),
    )
    observed, observer = observers.see(setup, params.observers, before, sent.clean, fresh, robot)
    down = signals.runlevel == run_levels.PEDAL_DOWN

    watched = None
    if params.detectors is not None and state.detectors is not None:
        views = (
            _views(setup, sent.packet, done, observer, now) if detectors.sources(setup) else None
        )
        limit = params.control.overdrive.dac_max
        view = connections.watched(limit, signals, robots, observer.cues, observer.live, now, views)
        watched = detectors.step(setup, params.detectors, state.detectors, view)
    # The monitor comes after the detectors: a CPU has its many operations to do while a detector's
    # wait for each other.
    golden = observers.Golden(signal.reference, signal.apart)
    judgement = observers.judge(
        setup, params.observers, before, sent.clean, fresh, robot, observer, golden, now
    )
    hands, reacting = sent.hands, sent.reacting
    if hands is not None:
        off_plan = operator.tip_offset(setup, params.operator, hands)
        hands = operator.sent(hands, fresh)
        if params.reaction is not None and reacting is not None:
            pulls = tuple(out.force[0] for out in observer.cues)
            view = reaction.OperatorSenses(
                pulls,
                observer.tips,
                tuple(out.tip_position for out in observer.models),
                off_plan,
                down,
                now,
            )
            reacting, correction = reaction.feel(setup, params.reaction, reacting, view)
            hands = operator.steered(setup, params.operator, hands, correction)
    pulled, hands = _pulled(setup, params, state, hands, observer.cues)
    own = sent.own
    if own is not None:
        shown_tips = tuple(out.tip_position for out in observer.models)
        own = own_operator.see(
            setup, own, observer.tips, shown_tips, observer.cues, signals.runlevel
        )
    state = TickState(
        faults=inject.state,
        control=done.software,
        boards=done.boards,
        commands=(done.boards.current_cmd, *state.commands)[: setup.command_delay],
        plc=done.plc,
        plant=done.plant,
        enc_val=tuple(out.enc_val for out in robots),
        motors=connections.motors(setup, robots),
        nominal=observed.nominal,
        haptics=observed.haptics,
        hands=hands,
        reaction=reacting,
        own_operator=own,
        hand=pulled,
        channel=sent.channel,
        clock=clock,
        history=history,
        detectors=watched,
        guard=lookout.state,
        monitor=judgement,
        overload=_overload(params, state.overload, robots, now),
        touch=None if state.touch is None else touch.step(state.touch, connections.touches(robots)),
        pedal_ticks=jnp.where(down, jnp.maximum(state.pedal_ticks, -1) + 1, -1),
        pedal_down_ticks=state.pedal_down_ticks + as_int(observer.live),
        packet=sequence,
        delivered=jnp.where(sent.arrives, sent.sequence - 1, state.delivered),
    )
    state = replace(state, monitor=failure.watched(state, robots, now))
    out = TickSignals(
        packet=sent.packet,
        control=signals,
        plant=robots,
        boards=done.boards.current_cmd,
        plc=done.relays,
        nominal=observer.models,
        haptics=observer.cues,
        tip=observer.tips,
        depth=observer.depth,
        tip_distance=observer.distance,
        fault_active=tuple(slot.active for slot in inject.state.slots),
    )
    return state, out


def _pulled(
    setup: RavenSetup,
    params: TickParams,
    state: TickState,
    hands: operator.HandOffsets | None,
    cues: tuple[haptics.HapticOutput, ...],
) -> tuple[tuple[hand.HandState, ...] | None, operator.HandOffsets | None]:
    """Hands that the cue's force moves: their state, and the offsets that the console sends from
    the next tick on.
    """
    if params.hand is None or state.hand is None or hands is None:
        return state.hand, hands
    own, before = params.hand, state.hand
    pulls = per_arm(
        setup, lambda i, arm: position_to_itp(arm, cues[i].direction * cues[i].force[0])
    )
    after = tuple(hand.step(setup, own, one, pull) for one, pull in zip(before, pulls, strict=True))
    moves = tuple(
        (new.displacement - old.displacement) * 1e6 for new, old in zip(after, before, strict=True)
    )
    return after, operator.strayed(hands, moves)


class _Sent(NamedTuple):
    """What the console and the network leave of this tick."""

    clean: Any  # packet.Packet as the console meant it: what the nominal model follows
    packet: Any  # packet.Packet as it reaches the robot
    arrives: Scalar  # bool
    sequence: Scalar  # int32, number of that packet
    hands: operator.HandOffsets | None
    reacting: reaction.ReactionState | None
    own: own_operator.OwnOperatorState | None
    channel: channel.ChannelState | None


def _console_and_network(
    setup: RavenSetup,
    params: TickParams,
    inject: RavenInjector,
    state: TickState,
    signal: Input,
    fresh: Scalar,
    sequence: Scalar,
) -> _Sent:
    """The robot's packet, and the clean one."""
    timing = _timing(state, sequence)
    reacting = _reacting(setup, params, state, signal.tick, timing.row)
    hands, own, deviation = state.hands, state.own_operator, own_operator.PLAN
    if own is not None and signal.packet is None:
        moment = _moment(state, sequence, fresh, signal.tick)
        own, hands, deviation = own_operator.act(
            setup, params.operator, own, hands, signal.motion, moment, fresh, signal.tick
        )
    if hands is not None and inject.strikes("hand"):
        hands = operator.strayed(
            hands, inject("hand", connections.each(setup, Vec.full(3, real(setup, 0.0))))
        )
    clean = signal.packet
    if clean is None:
        clean = connections.packet(
            setup,
            params.operator,
            params.reaction,
            signal.motion,
            reacting,
            hands,
            timing,
            deviation,
        )
    console = inject("console", connections.ConsoleSeam(params.operator.scale))
    line, network = _network(setup, params, inject, state, sequence, fresh)
    sent, again = (
        clean,
        signal.packet is None,
    )  # a packet from outside is not there to be sent again
    if again and inject.strikes("console", "network"):
        if state.clock is None:
            timing = connections.row_by_row(sequence - network.lag - network.delay)
        elif state.history is not None:
            timing = _older(state.history, signal.tick, sequence, network.lag + network.delay)
        sender = replace(params.operator, scale=console.scale)
        sent = connections.packet(
            setup, sender, params.reaction, signal.motion, reacting, hands, timing, deviation
        )
    arrives = fresh & ~network.lost
    if again and inject.strikes("network"):
        index = sent.sequence - 1
        arrives = arrives & (index >= 0) & ((network.delay == 0) | (index > state.delivered))
    packet = replace(sent, received=as_int(arrives))
    return _Sent(clean, packet, arrives, sent.sequence, hands, reacting, own, line)


class _Done(NamedTuple):
    """What the robot did in this tick."""

    software: control.ControlState
    signals: control.ControlSignals
    boards: usb.UsbOut
    plc: plc.PlcState
    relays: plc.PlcOutput
    plant: tuple[plant.PlantState, ...]
    robots: tuple[plant.PlantOutput, ...]


def _robot(
    setup: RavenSetup,
    params: TickParams,
    inject: RavenInjector,
    state: TickState,
    packet: Any,
    lookout: Unguarded,
) -> _Done:
    """Control computer and PLC; then motors, cables and links."""
    status = inject(
        "usb_status",
        connections.UsbStatus(
            connections.each(setup, jnp.int32(1)), connections.each(setup, jnp.int32(1))
        ),
    )
    pins = plc.input_pins(inject("plc", state.plc.runlevel))
    delivered = usb.UsbIn(inject("encoder", state.enc_val), connections.each(setup, pins))
    software, signals = control.cycle(
        setup,
        params.control,
        state.control,
        control.Inputs(packet, delivered, status.read_ok, state.motors),
        inject,
        lookout,
    )
    message = usb.UsbOut(
        tuple(arm.current_cmd_written for arm in signals.arms),
        connections.each(setup, signals.pins_out),
    )
    lookout.sees(boards_enc_val=delivered.enc_val)
    boards = usb.write(setup, state.boards, message, status.write_ok)
    boards = lookout.boards(state.boards, boards, state.plc.runlevel)

    pressed = detectors.stops(setup, state.detectors)
    buttons = inject("buttons", connections.Buttons(pressed, jnp.bool_(False)))
    plc_signal = plc.PlcSignal(
        boards.pins[: connections.boards_apart(setup)], buttons.estop, buttons.start
    )
    controller, relays = plc.step(setup, params.plc, state.plc, plc_signal)
    brakes = inject("brake", connections.brakes(setup, signals, relays))
    multipliers = {
        site: inject(site, connections.each(setup, Vec.full(7, neutral)))
        for site, neutral in _MECHANICS.items()
        if inject.strikes(site)
    }
    driven = connections.delayed(params.usb.command_delay, boards.current_cmd, state.commands)
    loads = per_arm(setup, lambda i, _: connections.plant_signal(driven[i], brakes, multipliers, i))
    moved = plant.step_all(setup, params.plant, state.plant, loads, params.contact)
    plants, robots = tuple(new for new, _ in moved), tuple(out for _, out in moved)
    return _Done(software, signals, boards, controller, relays, plants, robots)


# --- parts ---


_MECHANICS: dict[str, float] = {
    "torque_scale": 1.0,
    "cable_scale": 1.0,
    "friction_scale": 1.0,
    "external_torque": 0.0,
}
"""Sites of the robot's mechanics, with what they are where nothing is wrong."""


def _views(
    setup: RavenSetup, packet: Any, done: _Done, observer: observers.Seen, now: Scalar
) -> tuple[arm_view.ArmView, ...]:
    """What detectors of one's own see."""
    brakes = done.relays.brakes
    return connections.views(
        setup, packet, done.signals, done.boards, brakes, observer.models, observer.cues, now
    )


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
    ends = (
        setup.build != "robot"
    )  # a simulator's packet generator ends with the robot's software E-stop
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


def _timing(state: TickState, sequence: Scalar) -> connections.PacketTiming:
    """Which rows of the motion the newest packet is of: its own by number, or where a clock runs
    those of its time.
    """
    if state.clock is None:
        return connections.row_by_row(sequence)
    return connections.PacketTiming(sequence, state.clock.tick, state.clock.before)


def _moment(
    state: TickState, sequence: Scalar, fresh: Scalar, now: Scalar
) -> own_operator.PlanMoment:
    """Where the plan is: as its packets, or where a clock runs in its own time."""
    if state.clock is None:
        return own_operator.PlanMoment(sequence, sequence - 1, fresh)
    return own_operator.PlanMoment(now, now - 1, jnp.bool_(True))


def _older(
    history: packet_history.PacketHistory, now: Scalar, sequence: Scalar, packets: Scalar
) -> connections.PacketTiming:
    """Of the packet so many before the newest, which was made when it was sent; none is newer
    than that one.
    """
    packets = jnp.maximum(packets, 0)
    row, before = (now - packet_history.age(history, newer) for newer in (packets, packets + 1))
    return connections.PacketTiming(sequence - packets, row, before)


def _overload(
    params: TickParams,
    state: overload.OverloadState | None,
    robots: tuple[plant.PlantOutput, ...],
    now: Scalar,
) -> overload.OverloadState | None:
    """What the cables carried so far; None where nobody watches them."""
    if state is None:
        return None
    strengths = (arm.cable_strength for arm in params.plant)
    loads = tuple(
        out.carried * strength.map(_inverse)
        for out, strength in zip(robots, strengths, strict=True)
    )
    return overload.step(state, loads, now)


def _inverse(x: Scalar) -> Scalar:
    return 1.0 / x


def _reacting(
    setup: RavenSetup, params: TickParams, state: TickState, now: Scalar, sequence: Scalar
) -> reaction.ReactionState | None:
    """The operator's reaction before the packet of this tick; None where nobody reacts."""
    if params.reaction is None or state.reaction is None:
        return None
    return reaction.act(setup, params.reaction, state.reaction, now, sequence)


def _network(
    setup: RavenSetup,
    params: TickParams,
    inject: RavenInjector,
    state: TickState,
    sequence: Scalar,
    fresh: Scalar,
) -> tuple[channel.ChannelState | None, connections.Network]:
    """What becomes of this tick's packet on its way, and the channel after it."""
    ideal = connections.Network(
        jnp.int32(0), jnp.int32(0), jnp.bool_(False), real(setup, 0.0), real(setup, 0.0)
    )
    network, line = inject("network", ideal), state.channel
    if line is not None:
        line = channel.step(line, network.bursts, sequence, fresh)
        network = replace(network, lost=network.lost | (line.burst > 0))
    if seeded(setup, "jitter"):
        late = channel.delay_ms(network.jitter, sequence)
        network = replace(
            network, delay=network.delay + _packets_within(params, state.history, late)
        )
    return line, network


def _packets_within(
    params: TickParams, history: packet_history.PacketHistory | None, ms: Scalar
) -> Scalar:
    """How many of the console's packets are younger than `ms`: as many are still on their way."""
    if history is not None:
        return packet_history.sent_within(history, ms)
    cycles = jnp.maximum(params.network.cycles_per_packet, 1)
    return lax.div(ms + cycles - 1, cycles)
