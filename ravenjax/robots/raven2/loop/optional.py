"""Defines the optional stages of the tick in STAGES. A tick contains a stage if `Setup.stages` has
its name, or if the stage's function `needed` returns true.

To add a stage, add an entry to STAGES. `TickParams.stages` then holds the stage's parameters, which
a campaign varies as `NAME.parameter`. `TickState.stages` holds the stage's state. The result table
holds its outcomes, which `columns.csv.j2` lists. A campaign file can ask for the stages in `stages`
of `declaration.toml`. A run fails if one of the stage's `numbers` is not finite.
"""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

from ravenjax.numbers import for_each_arm, jnp
from ravenjax.numbers.vec import Scalar, Vec, as_int, first_tick, record, replace
from ravenjax.robots.raven2.console import operator, reaction
from ravenjax.robots.raven2.console.operator import PacketTiming
from ravenjax.robots.raven2.geometry.mapping import position_to_itp
from ravenjax.robots.raven2.loop import control, own_operator, records
from ravenjax.robots.raven2.loop.injector import may_restart, seeds_network
from ravenjax.robots.raven2.loop.records import Console, Network, PlanMoment, Sight, Start
from ravenjax.robots.raven2.plant import contact
from ravenjax.robots.raven2.run_levels import E_STOP
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import channel, detectors, hand, overload, packet_clock, packet_history, touch


def _keep_state(state, seen) -> Any:
    return state


class Stage(NamedTuple):
    """One optional stage. `act`, `transmit` and `watch` run at three moments of the tick."""

    init: Callable[[Start], Any]
    # Whether other settings need the stage, although `Setup.stages` does not have its name
    needed: Callable[[RavenSetup], bool] = lambda setup: False
    params: Callable[[RavenSetup], Any] = lambda setup: None  # record of parameters, or None
    act: Callable[[Any, Console], Any] = _keep_state  # Before the console makes its packet
    # Between console and robot
    transmit: Callable[[Any, Console, Network], tuple[Any, Network]] = (
        lambda state, console, network: (state, network)
    )
    watch: Callable[[Any, Sight], Any] = _keep_state  # After the robot has moved
    outcomes: Callable[[RavenSetup, Any], dict[str, Scalar]] = lambda setup, state: {}
    numbers: Callable[[Any], dict[str, list[Scalar]]] = lambda state: {}
    moves_hands: bool = False
    early: bool = False  # True: `watch` runs before the monitor, which makes the code faster


def find_stages(setup: RavenSetup) -> dict[str, Stage]:
    """Return the stages that are in the tick, by name."""
    return {
        name: stage for name, stage in STAGES.items() if name in setup.stages or stage.needed(setup)
    }


def _time_packets(clock: packet_clock.PacketClock, console: Console) -> packet_clock.PacketClock:
    """Return the packet clock after this tick. Set the console's newest packet and its timing.
    A packet is sent when the last one has lasted as many cycles as were drawn for it.
    """
    setup, network, now = console.setup, console.params.network, console.signal.tick
    if console.signal.packet is None:
        fresh = now >= clock.due
        # The packet generator of a simulator build ends with the robot's software E-stop.
        fresh = fresh & (console.soft_estopped == 0) if setup.build != "robot" else fresh
        console.fresh, console.sequence = fresh, console.newest + as_int(fresh)
        cycles = packet_clock.packet_length(
            setup.packets, network.packets, network.packet_key, console.sequence
        )
        clock = packet_clock.step(clock, now, fresh, cycles)
    console.timing = PacketTiming(console.sequence, clock.tick, clock.before)
    # The newest packet arrives. If network faults can deliver an earlier packet, the stage
    # `history` then replaces this function.
    console.older = lambda network: console.timing
    # In each tick the hands move on by one row of the planned motion.
    console.plan = PlanMoment(row=now, before=now - 1, continues=jnp.bool_(True))
    return clock


def _remember_packet_times(history: Vec, console: Console) -> Vec:
    # Stores when packets were sent, because a network fault may deliver an earlier packet.
    now, history = console.signal.tick, packet_history.step(history, console.fresh)

    def arriving_packet(network: Network) -> PacketTiming:
        # `lag` and `delay` are numbers of packets. The arriving packet contains the motion since
        # the packet before it, so the result has the times at which both packets were sent.
        late = jnp.maximum(network.lag + network.delay, 0)
        ages = (packet_history.packet_age(history, packets) for packets in (late, late + 1))
        sent, sent_before = (now - age for age in ages)
        return PacketTiming(console.sequence - late, sent, sent_before)

    console.older = arriving_packet
    console.packets_in = lambda ms: packet_history.sent_within(history, ms)
    return history


def _react(state: reaction.ReactionState, console: Console) -> reaction.ReactionState:
    # Decides whether the reaction to the cue begins. `deviate` then tells the console how a packet,
    # with the motion from row `timing.before` to row `timing.row`, deviates from the plan.
    setup, params = console.setup, console.params.stages["reaction"]
    reacted = reaction.react_to_cue(setup, params, state, console.signal.tick, console.timing.row)
    console.deviate = lambda timing: reaction.packet_deviation(
        setup, params, reacted, timing.row, timing.before
    )
    return reacted


def _lose_bursts(
    state: channel.ChannelState, console: Console, network: Network
) -> tuple[channel.ChannelState, Network]:
    # Marks the newest packet as lost while the channel loses several packets in a row.
    state = channel.step(state, network.bursts, console.sequence, console.fresh)
    return state, replace(network, lost=network.lost | (state.burst > 0))


def _feel_cue(state, sight: Sight) -> Any:
    # Computes what the operator feels, and the motion of the hands that corrects the tip.
    setup, params, signals = sight.setup, sight.params, sight.signals
    senses = reaction.OperatorSenses(
        # The operator feels the first haptic set.
        force=tuple(cue.force[0] for cue in signals.haptics),
        tip=signals.tip,
        model_tip=sight.model_tips,
        off_plan=operator.tip_offset(setup, params.operator, sight.hands),
        pedal_down=sight.pedal_down,
        tick=sight.tick,
    )
    state, correction = reaction.feel_cue(params.stages["reaction"], state, senses)
    sight.hands = operator.add_tip_motion(setup, params.operator, sight.hands, correction)
    return state


def _move_hand(state, sight: Sight) -> Any:
    # The force of the first haptic set displaces the hands. The next packet contains this motion.
    setup, hand_params, cues = sight.setup, sight.params.stages["hand"], sight.signals.haptics
    pushed = tuple(
        hand.step(setup, hand_params, old, position_to_itp(arm, cue.direction * cue.force[0]))
        for arm, old, cue in zip(setup.arms, state, cues, strict=True)
    )
    motions_um = tuple(
        (new.displacement - old.displacement) * 1e6 for new, old in zip(pushed, state, strict=True)
    )
    sight.hands = operator.add_hand_motion(sight.hands, motions_um)
    return pushed


@record
class RestartState:
    """Whether the robot became live again after a stop, while the foot stayed on the pedal."""

    stopped_under_foot: Scalar  # bool, not live since a stop, and the foot is on the pedal since
    restart_tick: Scalar  # int32, tick of the first restart; -1: none


def _watch_restart(state: RestartState, sight: Sight) -> RestartState:
    # Records the first tick in which the robot restarts under a foot that stayed on the pedal.
    control = sight.signals.control
    stopped = (control.runlevel == E_STOP) | (control.soft_estopped != 0)
    under_foot = sight.foot_on_pedal & (state.stopped_under_foot | stopped)
    restart_tick = first_tick(sight.tick, under_foot & sight.live, state.restart_tick)
    return RestartState(under_foot & ~sight.live, restart_tick)


def _detect(state, sight: Sight) -> Any:
    # Computes the detectors, which read signals that a real robot has, and not the true tip.
    setup, params = sight.setup, sight.params
    signals = sight.signals
    models, cues = signals.nominal, signals.haptics
    # `note` adds signals to the views of users' files.
    sight.files.note(
        brakes=signals.plc.brakes,
        model_jpos=tuple(model.jpos for model in models),
        model_tip=sight.model_tips,
        tip_error=tuple(cue.distance for cue in cues),
    )
    views: tuple[Any, ...] = ()
    if detectors.detector_files(setup):
        # The cue's error is the model's tip minus the reported tip.
        pairs = zip(sight.model_tips, cues, strict=True)
        sight.files.note(tip=tuple(model_tip - cue.error for model_tip, cue in pairs))
        views = sight.files.views("the end", setup.precision.real)
    signal = detectors.DetectorSignal(
        **control.columns_of(signals.plant, "mpos", "mvel", "jpos", "jvel"),
        tip_error=tuple(cue.distance for cue in cues),
        command=tuple(arm.current_cmd for arm in signals.control.arms),
        command_limit=params.control.overdrive.dac_max,
        armed=sight.live,
        tick=sight.tick,
        views=views,
    )
    return detectors.step(setup, params.stages["detectors"], state, signal)


def _add_loads(state, sight: Sight) -> Any:
    # Adds each cable's load in this tick: the largest tension difference, as a share of strength.
    loads = tuple(
        out.carried * arm.cable_strength.map(lambda strength: 1.0 / strength)
        for out, arm in zip(sight.signals.plant, sight.params.plant, strict=True)
    )
    return overload.step(state, loads, sight.tick)


STAGES: dict[str, Stage] = {
    "clock": Stage(
        init=lambda start: packet_clock.init(),
        needed=lambda setup: bool(setup.packets),
        act=_time_packets,
    ),
    "history": Stage(
        init=lambda start: packet_history.init(start.setup.packet_history),
        needed=lambda setup: setup.packet_history > 0,
        act=_remember_packet_times,
    ),
    "reaction": Stage(
        init=lambda start: reaction.init(),
        params=lambda setup: reaction.ReactionParams(),
        act=_react,
        watch=_feel_cue,
        outcomes=lambda setup, state: {"reaction_ms": state.acted},
        moves_hands=True,
    ),
    "hand": Stage(
        init=lambda start: for_each_arm(start.setup, hand.init(start.setup)),
        params=lambda setup: hand.HandParams(),
        watch=_move_hand,
        outcomes=hand.outcomes,
        moves_hands=True,
    ),
    "channel": Stage(
        init=lambda start: channel.init(),
        needed=lambda setup: seeds_network(setup, "bursts"),
        transmit=_lose_bursts,
    ),
    "detectors": Stage(
        init=lambda start: detectors.init(start.setup, start.params.stages["detectors"]),
        needed=lambda setup: bool(setup.detectors),
        params=detectors.params,
        watch=_detect,
        outcomes=detectors.outcomes,
        early=True,
    ),
    "overload": Stage(
        init=lambda start: overload.init(start.setup),
        watch=_add_loads,
        outcomes=overload.outcomes,
        numbers=lambda state: {"cable": [state.peak]},
    ),
    "contact": Stage(
        init=lambda start: touch.init(start.setup),
        params=lambda setup: contact.ContactParams(),
        watch=lambda state, sight: touch.step(
            state, tuple(out.touch for out in sight.signals.plant)
        ),
        outcomes=touch.outcomes,
        numbers=lambda state: {"contact": [state.impulse]},
    ),
    "restart": Stage(
        init=lambda start: RestartState(jnp.bool_(False), jnp.int32(-1)),
        needed=lambda setup: any(may_restart(*key) for key in setup.injection.channels),
        watch=_watch_restart,
        outcomes=lambda setup, state: {"restart_ms": state.restart_tick},
    ),
    "own_operator": Stage(
        init=own_operator.init,
        needed=lambda setup: setup.hands is not None,
        act=own_operator.act_as_file,
        watch=own_operator.show_state,
        numbers=lambda state: {} if state.grasp is None else {"hand": [*state.grasp.offset]},
        moves_hands=True,
    ),
}
"""All optional stages, in the order in which they act."""

Params = dataclasses.make_dataclass(
    "Params",
    [(name, type(stage.params(RavenSetup()))) for name, stage in STAGES.items()],
    bases=(records.TickParams,),
    frozen=True,
)
"""Every parameter that a campaign may vary, by path: `TickParams` with a field for each stage."""
