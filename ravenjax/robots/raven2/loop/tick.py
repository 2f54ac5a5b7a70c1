"""One millisecond of everything, on one page: console, network, control software, PLC, robot, nominal model, cue.

The order is the robot's own: sense, decide, check, write; the plant moves last and its encoders are read in the next
tick. Faults strike at the sites named here and in `control`. The nominal model runs beside the robot on the *clean*
operator input; the monitor compares it with the robot and the console's haptic device pulls.
"""

from __future__ import annotations

from typing import Annotated, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax import lax

from ravenjax.faults import fault, injection, window
from ravenjax.faults.injector import strikes
from ravenjax.numbers.quantity import Quantity, Reserved
from ravenjax.numbers.setup import per_arm, real
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, replace
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.console import operator, reaction
from ravenjax.robots.raven2.geometry.mapping import position_to_itp
from ravenjax.robots.raven2.loop import connections, control, observers
from ravenjax.robots.raven2.loop.injector import RavenInjector
from ravenjax.robots.raven2.plant import nominal, parameter_sets
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import plc, usb
from ravenjax.stages import channel, check, detectors, hand, haptics, monitor, overload, packet_clock
from ravenjax.stages.check import CheckHistory
from ravenjax.vocabulary import packets

# --- records: one entry an arm in each tuple ---


@record
class TickParams:
    """Everything that a campaign may vary, one sub-record a stage."""

    operator: operator.OperatorParams
    network: NetworkParams
    usb: UsbParams
    control: control.ControlParams
    plc: plc.PlcParams
    plant: tuple[plant.PlantParams, ...]
    nominal: tuple[nominal.NominalParams, ...]
    haptics: haptics.HapticParams
    reaction: reaction.ReactionParams | None  # where Setup.reacts
    hand: hand.HandParams | None  # where Setup.hand_yields
    detectors: detectors.DetectorParams | None  # where there are any
    monitor: Annotated[monitor.MonitorParams, Reserved("it belongs to the observer, not to the robot")]
    start: Annotated[  # joints where the run begins, 7, rad and m
        tuple[Vec, ...], Reserved("it is where the operator's motion begins; write [operator.start]")
    ]


@record
class NetworkParams:
    """The channel from console to robot."""

    cycles_per_packet: Annotated[  # int32; 1: a packet a millisecond
        Scalar, Quantity("cycles", 1, 1000, "how long a packet of the console lasts", whole=True)
    ]
    packets: Annotated[  # int32, one of vocabulary.packets
        Scalar,
        Quantity(
            "",
            0,
            3,
            "how long packets last, drawn: 0 every_cycle, 1 measured, 2 bursts, 3 the shares in campaign.packets",
            whole=True,
        ),
    ]
    packet_key: Annotated[  # uint32; a run and its golden run share it
        Scalar,
        Reserved("it is derived from each run's id, so that no two runs draw the same packets; set campaign.packets"),
    ]


@record
class UsbParams:
    """The way from USB board to motor."""

    command_delay: Annotated[  # int32, at most Setup.command_delay
        Scalar, Quantity("ms", 0, 16, "from USB write to motor", whole=True)
    ]


@record
class TickState:
    """What is remembered from one tick to the next; each part is written by its own stage only."""

    faults: fault.FaultState
    control: control.ControlState
    boards: usb.UsbOut  # what the USB boards hold
    commands: tuple[tuple[Vec, ...], ...]  # int32, what the boards held in the ticks before, latest first
    plc: plc.PlcState
    plant: tuple[plant.PlantState, ...]
    enc_val: tuple[Vec, ...]  # int32 counts that the encoders show
    motors: tuple[tuple[Vec, Vec], ...] | None  # rad, rad/s of motors 1-3, for the dynamics-simulator builds alone
    nominal: tuple[nominal.NominalState, ...]
    haptics: tuple[haptics.HapticState, ...]
    hands: operator.HandOffsets | None  # where they may do more than is planned
    reaction: reaction.ReactionState | None
    hand: tuple[hand.HandState, ...] | None  # where the cue's force moves it
    channel: channel.ChannelState | None  # where faults seed it
    clock: packet_clock.PacketClock | None  # where Setup.packets
    detectors: detectors.DetectorsState | None
    monitor: monitor.MonitorState
    overload: overload.OverloadState | None  # where Setup.cables are watched
    pedal_ticks: Scalar  # int32, ticks since pedal-down was entered; negative: not in it
    pedal_down_ticks: Scalar  # int32, ticks in pedal-down so far
    packet: Scalar  # int32, index of the console's newest packet; -1: none yet
    delivered: Scalar  # int32, index of the packet that last reached the robot; -1: none yet


@record
class Input:
    """What enters a tick from outside."""

    tick: Scalar  # int32, ticks since the run began
    motion: tuple[Any, ...]  # columns of the operator's motion, each a 1-D array: the only arrays of the tick
    reference: monitor.Reference  # the golden run in this tick
    packet: Any = None  # packet.Packet of a console outside, in place of those that the motion makes
    apart: Any = None  # bool, False: nothing has struck so far, and the robot is its own golden run


@record
class TickSignals:
    """What crossed the seams in this tick; also the schema of a trace."""

    packet: Any  # packet.Packet as it reached the robot
    control: control.ControlSignals
    plant: tuple[plant.PlantOutput, ...]
    plc: plc.PlcOutput
    nominal: tuple[nominal.NominalOutput, ...]
    haptics: tuple[haptics.HapticOutput, ...]
    tip: tuple[Vec, ...]  # m, true tip in frame 0
    depth: tuple[Scalar, ...]  # m below the tissue's surface, negative above
    tip_distance: Scalar  # m between the tips; infinite with one arm
    fault_active: tuple[Scalar, ...]  # bool, one a slot


# --- the tick ---


def tick(
    setup: RavenSetup, params: TickParams, faults: fault.Faults, state: TickState, signal: Input
) -> tuple[TickState, TickSignals]:
    """One millisecond of one robot."""
    now = signal.tick
    fresh, sequence, clock = _packet_due(setup, params, state, signal)
    triggers = window.TriggerClocks(now, sequence + 1, state.pedal_ticks)
    inject = RavenInjector(setup, faults, window.open_windows(setup, faults, state.faults, triggers), triggers)

    sent = _console_and_network(setup, params, inject, replace(state, clock=clock), signal, fresh, sequence)
    done = _robot(setup, params, inject, state, sent.packet)
    signals, robots = done.signals, done.robots
    observed, observer = observers.observe(
        setup,
        _observed(params),
        observers.ObserverState(state.nominal, state.haptics, state.monitor),
        sent.clean,
        fresh,
        observers.RobotView(
            jpos=tuple(arm.jpos for arm in signals.arms),
            mvel=tuple(arm.mvel for arm in signals.arms),
            runlevel=signals.runlevel,
            soft_estopped=done.software.state_machine.soft_estopped,
            dac=done.boards.current_cmd,
            pos=tuple(arm.pos.position_um for arm in signals.arms),
            tips=_tips(setup, params, done.plant, robots),
        ),
        observers.Golden(signal.reference, signal.apart),
        now,
    )
    down = signals.runlevel == run_levels.PEDAL_DOWN

    watched = None
    if params.detectors is not None and state.detectors is not None:
        view = connections.watched(params.control.overdrive.dac_max, signals, robots, observer.cues, observer.live, now)
        watched = detectors.step(setup, params.detectors, state.detectors, view)
    hands, reacting = sent.hands, sent.reacting
    if hands is not None:
        off_plan = operator.tip_offset(setup, params.operator, hands)
        hands = operator.sent(hands, fresh)
        if params.reaction is not None and reacting is not None:
            pulls = tuple(out.force[0] for out in observer.cues)
            view = reaction.OperatorSenses(
                pulls, observer.tips, tuple(out.tip_position for out in observer.models), off_plan, down, now
            )
            reacting, correction = reaction.feel(setup, params.reaction, reacting, view)
            hands = operator.steered(setup, params.operator, hands, correction)
    pulled, hands = _pulled(setup, params, state, hands, observer.cues)
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
        hand=pulled,
        channel=sent.channel,
        clock=clock,
        detectors=watched,
        monitor=observed.monitor,
        overload=_overload(params, state.overload, robots, now),
        pedal_ticks=jnp.where(down, jnp.maximum(state.pedal_ticks, -1) + 1, -1),
        pedal_down_ticks=state.pedal_down_ticks + as_int(observer.live),
        packet=sequence,
        delivered=jnp.where(sent.arrives, sent.sequence - 1, state.delivered),
    )
    out = TickSignals(
        packet=sent.packet,
        control=signals,
        plant=robots,
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
    """Hands that the cue's force moves: their state, and the offsets that the console sends from the next tick on."""
    if params.hand is None or state.hand is None or hands is None:
        return state.hand, hands
    own, before = params.hand, state.hand
    pulls = per_arm(setup, lambda i, arm: position_to_itp(arm, cues[i].direction * cues[i].force[0]))
    after = tuple(hand.step(setup, own, one, pull) for one, pull in zip(before, pulls, strict=True))
    moves = tuple((new.displacement - old.displacement) * 1e6 for new, old in zip(after, before, strict=True))
    return after, operator.strayed(hands, moves)


class _Sent(NamedTuple):
    """What the console and the network leave of this tick."""

    clean: Any  # packet.Packet as the console meant it: what the nominal model follows
    packet: Any  # packet.Packet as it reaches the robot
    arrives: Scalar  # bool
    sequence: Scalar  # int32, number of that packet
    hands: operator.HandOffsets | None
    reacting: reaction.ReactionState | None
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
    hands = state.hands
    if hands is not None and inject.strikes("hand"):
        hands = operator.strayed(hands, inject("hand", _each(setup, Vec.full(3, real(setup, 0.0)))))
    clean = signal.packet
    if clean is None:
        clean = connections.packet(setup, params.operator, params.reaction, signal.motion, reacting, hands, timing)
    console = inject("console", connections.ConsoleSeam(params.operator.scale))
    line, network = _network(setup, params, inject, state, sequence, fresh)
    sent, again = clean, signal.packet is None  # a packet from outside is not there to be sent again
    if again and inject.strikes("console", "network"):
        if state.clock is None:
            timing = connections.row_by_row(sequence - network.lag - network.delay)
        sender = replace(params.operator, scale=console.scale)
        sent = connections.packet(setup, sender, params.reaction, signal.motion, reacting, hands, timing)
    arrives = fresh & ~network.lost
    if again and inject.strikes("network"):
        index = sent.sequence - 1
        arrives = arrives & (index >= 0) & ((network.delay == 0) | (index > state.delivered))
    packet = replace(sent, received=as_int(arrives))
    return _Sent(clean, packet, arrives, sent.sequence, hands, reacting, line)


class _Done(NamedTuple):
    """What the robot did in this tick."""

    software: control.ControlState
    signals: control.ControlSignals
    boards: usb.UsbOut
    plc: plc.PlcState
    relays: plc.PlcOutput
    plant: tuple[plant.PlantState, ...]
    robots: tuple[plant.PlantOutput, ...]


def _robot(setup: RavenSetup, params: TickParams, inject: RavenInjector, state: TickState, packet: Any) -> _Done:
    """Control computer and PLC; then motors, cables and links."""
    status = inject("usb_status", connections.UsbStatus(_each(setup, jnp.int32(1)), _each(setup, jnp.int32(1))))
    pins = plc.input_pins(inject("plc", state.plc.runlevel))
    delivered = usb.UsbIn(inject("encoder", state.enc_val), _each(setup, pins))
    software, signals = control.cycle(
        setup, params.control, state.control, control.Inputs(packet, delivered, status.read_ok, state.motors), inject
    )
    message = usb.UsbOut(tuple(arm.current_cmd_written for arm in signals.arms), _each(setup, signals.pins_out))
    boards = usb.write(setup, state.boards, message, status.write_ok)

    buttons = inject("buttons", connections.Buttons(jnp.bool_(False), jnp.bool_(False)))
    plc_signal = plc.PlcSignal(boards.pins[: _boards_apart(setup)], buttons.estop, buttons.start)
    controller, relays = plc.step(setup, params.plc, state.plc, plc_signal)
    brakes = inject("brake", connections.brakes(setup, signals, relays))
    multipliers = {
        site: inject(site, _each(setup, Vec.full(7, neutral)))
        for site, neutral in _MECHANICS.items()
        if inject.strikes(site)
    }
    driven = connections.delayed(params.usb.command_delay, boards.current_cmd, state.commands)
    moved = per_arm(
        setup,
        lambda i, arm: plant.step(
            setup, arm, params.plant[i], state.plant[i], connections.plant_signal(driven[i], brakes, multipliers, i)
        ),
    )
    plants, robots = tuple(new for new, _ in moved), tuple(out for _, out in moved)
    return _Done(software, signals, boards, controller, relays, plants, robots)


def _tips(
    setup: RavenSetup, params: TickParams, states: tuple[plant.PlantState, ...], robots: tuple[plant.PlantOutput, ...]
) -> tuple[Vec, ...]:
    """True tips, m."""
    return per_arm(setup, lambda i, arm: plant.tip(arm, params.plant[i], states[i], robots[i].jpos))


def _observed(params: TickParams) -> observers.ObserverParams:
    return observers.ObserverParams(params.nominal, params.haptics, params.monitor)


# --- its beginning and end ---


def params(
    setup: RavenSetup, start_jpos: tuple[tuple[float, ...], ...], parameter_set: str = parameter_sets.DEFAULT
) -> TickParams:
    """Every parameter at its documented value, for a run that begins at `start_jpos` (7 joints per arm, rad and m).

    parameter_set: mechanics of the virtual robot, one of `parameter_sets.Name`.
    """
    return TickParams(
        operator=operator.params(setup, start_jpos),
        network=NetworkParams(np.int32(1), np.int32(packets.EVERY_CYCLE), np.uint32(0)),
        usb=UsbParams(np.int32(0)),
        control=control.params(setup),
        plc=plc.params(setup),
        plant=per_arm(setup, lambda _, arm: plant.params(setup, arm, parameter_set)),
        nominal=per_arm(setup, lambda _, arm: nominal.params(setup, arm, parameter_set)),
        haptics=haptics.params(setup),
        reaction=reaction.params(setup) if setup.reacts else None,
        hand=hand.params(setup) if setup.hand_yields else None,
        detectors=detectors.params(setup) if setup.detectors else None,
        monitor=monitor.params(setup),
        start=tuple(Vec(jpos) for jpos in start_jpos),
    )


def init(setup: RavenSetup, params: TickParams) -> TickState:
    """A homed robot at rest at `params.start`, pedal up, ready; its nominal model at the same place."""
    ready = run_levels.PEDAL_UP if setup.software == "raven2" else run_levels.PEDAL_DOWN
    start = real(setup, params.start)
    plants = per_arm(setup, lambda i, arm: plant.init(setup, arm, params.plant[i], start[i]))
    robots = per_arm(setup, lambda i, arm: plant.observe(setup, arm, params.plant[i], plants[i]))
    tips = _tips(setup, params, plants, robots)
    beside = observers.init(setup, _observed(params), start, tips)
    zero = jnp.int32(0)
    with jax.ensure_compile_time_eval():  # where a run begins is a constant of the campaign
        software = control.init(setup, params.start, ready)
    return TickState(
        faults=fault.init(setup),
        control=software,
        boards=usb.init_out(setup),
        commands=(_each(setup, Vec.full(7, zero)),) * setup.command_delay,
        plc=plc.init(setup, params.plc, ready, _boards_apart(setup)),
        plant=plants,
        enc_val=tuple(out.enc_val for out in robots),
        motors=connections.motors(setup, robots),
        nominal=beside.nominal,
        haptics=beside.haptics,
        hands=operator.at_plan(setup) if setup.reacts or setup.hand_yields or strikes(setup, "hand") else None,
        reaction=reaction.init(setup) if setup.reacts else None,
        hand=_each(setup, hand.init(setup)) if setup.hand_yields else None,
        channel=channel.init() if _seeded(setup, "bursts") else None,
        clock=packet_clock.init() if setup.packets else None,
        detectors=detectors.init(setup) if setup.detectors else None,
        monitor=beside.monitor,
        overload=None if setup.cables == "unwatched" else overload.init(setup),
        pedal_ticks=jnp.int32(-1),
        pedal_down_ticks=jnp.int32(0),
        packet=jnp.int32(-1),
        delivered=jnp.int32(-1),
    )


def outcomes(setup: RavenSetup, params: TickParams, state: TickState) -> dict[str, Scalar]:
    """What became of the run so far; columns of the result table before the verdict."""
    out = fault.outcomes(state.faults) | check.outcomes(checks(state)) | haptics.outcomes(setup, state.haptics)
    machine = state.control.state_machine
    out["end_runlevel"] = jnp.where(machine.soft_estopped != 0, run_levels.E_STOP, machine.runlevel)
    out["pedal_down_ms"] = state.pedal_down_ticks
    if state.reaction is not None:
        out["reaction_ms"] = state.reaction.acted
    if state.hand is not None:
        out |= hand.outcomes(setup, state.hand)
    if state.detectors is not None:
        out |= detectors.outcomes(setup, state.detectors)
    if state.overload is not None:
        out |= overload.outcomes(state.overload)
    return out | monitor.outcomes(setup, state.monitor)


def reference_series(setup: RavenSetup, signals: TickSignals) -> tuple[Scalar, ...]:
    """The numbers of a fault-free tick that its faulty brothers are compared with."""
    measured = connections.measured(setup, signals.control)
    return tuple(x for tip, pos in zip(signals.tip, measured, strict=True) for x in (*tip, *pos))


def advance(
    setup: RavenSetup,
    params: TickParams,
    faults: fault.Faults,
    state: TickState,
    now: Scalar,
    motion: tuple[Any, ...],
    golden: tuple[Scalar, ...],
) -> tuple[TickState, tuple[Scalar, ...], TickSignals]:
    """See `ravenjax.engines.interface.Loop`."""
    state, signals = tick(setup, params, faults, state, Input(now, motion, reference_from(setup, golden)))
    return state, reference_series(setup, signals), signals


def series_length(setup: RavenSetup) -> int:
    """How many numbers `reference_series` has."""
    return 6 * len(setup.arms)


def reference_from(setup: RavenSetup, series: Any) -> monitor.Reference:
    """The golden run's tick from those numbers."""
    rows = [Vec(series[i + j] for j in range(3)) for i in range(0, series_length(setup), 3)]
    return monitor.Reference(tip=tuple(rows[0::2]), pos=tuple(rows[1::2]))


def checks(state: TickState) -> dict[str, CheckHistory]:
    """Every built-in check by its name in `ravenjax.vocabulary.checks`; that of the worse arm."""
    software = state.control
    net, machine, over = software.network, software.state_machine, software.overdrive
    return {
        "overdrive_instant": over.instant,
        "overdrive_hard": over.hard,
        "overdrive_clip": over.clip,
        "soft_estop": machine.soft_estop,
        "plc_watchdog": state.plc.watchdog_lost,
        "estop": machine.estop,
        "ik_reject": check.worse([arm.ik_reject for arm in software.cartesian]),
        "joint_limit": check.worse([arm.joint_limit for arm in software.cartesian]),
        "master_timeout": software.teleoperation.timeout,
        "packet_size": net.size,
        "packet_zero": net.zero,
        "packet_skip": net.skip,
        "packet_duplicate": net.duplicate,
        "packet_reset": net.reset,
        "packet_order": net.out_of_sequence,
    }


# --- parts ---


def _seeded(setup: RavenSetup, what: str) -> bool:
    """Whether faults seed the channel's `bursts`, or its `jitter`."""
    return ("network", "", what) in injection.channel_keys(setup)


def _boards_apart(setup: RavenSetup) -> int:
    """USB boards whose output pins may differ: all are written alike, unless a write can fail."""
    return len(setup.arms) if strikes(setup, "usb_status") else 1


_MECHANICS: dict[str, float] = {
    "torque_scale": 1.0,
    "cable_scale": 1.0,
    "friction_scale": 1.0,
    "external_torque": 0.0,
}
"""Sites of the robot's mechanics, with what they are where nothing is wrong."""


def _each(setup: RavenSetup, item: Any) -> tuple[Any, ...]:
    return tuple(item for _ in setup.arms)


def _packet_due(
    setup: RavenSetup, params: TickParams, state: TickState, signal: Input
) -> tuple[Scalar, Scalar, packet_clock.PacketClock | None]:
    """Whether there is a new packet in this tick, the index of the newest one, and the clock after it."""
    if signal.packet is not None:
        fresh = signal.packet.received != 0
        return fresh, state.packet + as_int(fresh), state.clock
    now, cycles = signal.tick, params.network.cycles_per_packet
    stopped = state.control.state_machine.soft_estopped
    ends = setup.build != "robot"  # a simulator's packet generator ends with the robot's software E-stop
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
    """Which rows of the motion the newest packet is of: its own by number, or where a clock runs those of its time."""
    if state.clock is None:
        return connections.row_by_row(sequence)
    return connections.PacketTiming(sequence, state.clock.tick, state.clock.before)


def _overload(
    params: TickParams, state: overload.OverloadState | None, robots: tuple[plant.PlantOutput, ...], now: Scalar
) -> overload.OverloadState | None:
    """What the cables carried so far; None where nobody watches them."""
    if state is None:
        return None
    strengths = (arm.cable_strength for arm in params.plant)
    loads = tuple(out.carried * strength.map(_inverse) for out, strength in zip(robots, strengths, strict=True))
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
    setup: RavenSetup, params: TickParams, inject: RavenInjector, state: TickState, sequence: Scalar, fresh: Scalar
) -> tuple[channel.ChannelState | None, connections.Network]:
    """What becomes of this tick's packet on its way, and the channel after it."""
    ideal = connections.Network(jnp.int32(0), jnp.int32(0), jnp.bool_(False), real(setup, 0.0), real(setup, 0.0))
    network, line = inject("network", ideal), state.channel
    if line is not None:
        line = channel.step(line, network.bursts, sequence, fresh)
        network = replace(network, lost=network.lost | (line.burst > 0))
    if _seeded(setup, "jitter"):
        cycles = jnp.maximum(params.network.cycles_per_packet, 1)
        late = channel.delay_ms(network.jitter, sequence) + cycles - 1
        network = replace(network, delay=network.delay + lax.div(late, cycles))
    return line, network
