"""Defines the optional stages of the tick in STAGES. A tick contains a stage if the stage's
function `present` returns true.

To add a stage, add an entry to STAGES. `TickState.stages` then holds the stage's state, and the
result table holds its outcomes. A run fails if one of the stage's `numbers` is not finite.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

from ravenjax.faults.injection import channel_keys
from ravenjax.numbers import for_each_arm, jnp
from ravenjax.numbers.vec import Scalar, Vec, as_int, first_tick, record, replace
from ravenjax.robots.raven2.console import operator, reaction
from ravenjax.robots.raven2.console.operator import PacketTiming
from ravenjax.robots.raven2.geometry.mapping import position_to_itp
from ravenjax.robots.raven2.loop import control, own_operator
from ravenjax.robots.raven2.loop.injector import may_restart, seeds_network
from ravenjax.robots.raven2.loop.records import Console, Network, PlanMoment, Sight, Start
from ravenjax.robots.raven2.run_levels import E_STOP
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import channel, detectors, hand, overload, packet_clock, packet_history, touch


def _keep_state(state, seen) -> Any:
    return state


class Stage(NamedTuple):
    """One optional stage. `act`, `transmit` and `watch` run at three moments of the tick."""

    present: Callable[[RavenSetup], bool]
    init: Callable[[Start], Any]
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
    return {name: stage for name, stage in STAGES.items() if stage.present(setup)}


# --- before the console makes its packet ---


def _draw_length(clock: packet_clock.PacketClock, console: Console) -> packet_clock.PacketClock:
    """Draw the number of cycles that each packet lasts, and set when packets are sent."""
    setup, network, now = console.setup, console.params.network, console.signal.tick
    if console.signal.packet is None:
        fresh = now >= clock.due
        # A simulator's packet generator ends with the robot's software E-stop
        fresh = fresh & (console.soft_estopped == 0) if setup.build != "robot" else fresh
        console.fresh, console.sequence = fresh, console.newest + as_int(fresh)
        cycles = packet_clock.packet_length(
            setup.packets, network.packets, network.packet_key, console.sequence
        )
        clock = packet_clock.step(clock, now, fresh, cycles)
    console.timing = PacketTiming(console.sequence, clock.tick, clock.before)
    console.older = lambda network: console.timing
    console.plan = PlanMoment(now, now - 1, jnp.bool_(True))
    return clock


def _remember_packet(history: Vec, console: Console) -> Vec:
    # Stores when packets were sent, because a network fault may deliver an earlier packet.
    now, history = console.signal.tick, packet_history.step(history, console.fresh)

    def older(network: Network) -> PacketTiming:
        # A late packet contains the motion of the tick in which it was sent.
        count = jnp.maximum(network.lag + network.delay, 0)
        row, before = (now - packet_history.packet_age(history, n) for n in (count, count + 1))
        return PacketTiming(console.sequence - count, row, before)

    console.older = older
    console.packets_in = lambda late: packet_history.sent_within(history, late)
    return history


def _react(state: reaction.ReactionState, console: Console) -> reaction.ReactionState:
    # Decides whether the operator's action begins, and sets the deviations of packets.
    setup, params = console.setup, console.params.reaction
    assert params is not None
    after = reaction.react_to_cue(setup, params, state, console.signal.tick, console.timing.row)
    console.deviate = lambda timing: reaction.packet_deviation(
        setup, params, after, timing.row, timing.before
    )
    return after


# --- between console and robot ---


def _lose_bursts(
    state: channel.ChannelState, console: Console, network: Network
) -> tuple[channel.ChannelState, Network]:
    state = channel.step(state, network.bursts, console.sequence, console.fresh)
    return state, replace(network, lost=network.lost | (state.burst > 0))


# --- when the robot has moved ---


def _feel_cue(state, sight: Sight) -> Any:
    # Computes what the operator feels, and the motion of the hands that corrects the tip.
    setup, params, signals = sight.setup, sight.params, sight.signals
    assert params.reaction is not None
    senses = reaction.OperatorSenses(
        tuple(out.force[0] for out in signals.haptics),
        signals.tip,
        sight.model_tips,
        operator.tip_offset(setup, params.operator, sight.hands),
        sight.pedal_down,
        sight.tick,
    )
    state, correction = reaction.feel_cue(setup, params.reaction, state, senses)
    sight.hands = operator.add_tip_motion(setup, params.operator, sight.hands, correction)
    return state


def _move_hand(state, sight: Sight) -> Any:
    # The cue displaces the hands, and the displacement is part of the next packet.
    setup, hand_params, cues = sight.setup, sight.params.hand, sight.signals.haptics
    assert hand_params is not None
    after = tuple(
        hand.step(setup, hand_params, old, position_to_itp(arm, cue.direction * cue.force[0]))
        for arm, old, cue in zip(setup.arms, state, cues, strict=True)
    )
    motions = tuple(
        (new.displacement - old.displacement) * 1e6 for new, old in zip(after, state, strict=True)
    )
    sight.hands = operator.add_hand_motion(sight.hands, motions)
    return after


@record
class RestartState:
    """Whether the robot became live again after a stop, while the foot stayed on the pedal."""

    waits: Scalar  # bool, the foot has been on the pedal since a stop
    first: Scalar  # int32, tick of the first restart; -1: none


def _watch_restart(state: RestartState, sight: Sight) -> RestartState:
    # Records the first restart of the robot after a stop with the pedal down.
    control = sight.signals.control
    stopped = (control.runlevel == E_STOP) | (control.soft_estopped != 0)
    waits = sight.foot & (state.waits | stopped)
    first = first_tick(sight.tick, waits & sight.live, state.first)
    return RestartState(waits & ~sight.live, first)


def _detect(state, sight: Sight) -> Any:
    # Detectors read signals that a real robot has, and not the true tip.
    setup, params = sight.setup, sight.params
    assert params.detectors is not None
    signals = sight.signals
    models, cues = signals.nominal, signals.haptics
    sight.files.note(
        brakes=signals.plc.brakes,
        model_jpos=tuple(model.jpos for model in models),
        model_tip=sight.model_tips,
        tip_error=tuple(cue.distance for cue in cues),
    )
    views: tuple[Any, ...] = ()
    if detectors.detector_files(setup):
        tips = zip(models, cues, strict=True)
        sight.files.note(tip=tuple(model.tip_position - cue.error for model, cue in tips))
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
    return detectors.step(setup, params.detectors, state, signal)


def _add_loads(state, sight: Sight) -> Any:
    # Adds the cable tensions of this tick, divided by each cable's strength.
    loads = tuple(
        out.carried * arm.cable_strength.map(lambda strength: 1.0 / strength)
        for out, arm in zip(sight.signals.plant, sight.params.plant, strict=True)
    )
    return overload.step(state, loads, sight.tick)


def _add_touches(state, sight: Sight) -> Any:
    touches = (out.touch for out in sight.signals.plant)
    return touch.step(state, tuple(contact for contact in touches if contact is not None))


STAGES: dict[str, Stage] = {
    "clock": Stage(
        present=lambda setup: bool(setup.packets),
        init=lambda start: packet_clock.init(),
        act=_draw_length,
    ),
    "history": Stage(
        present=lambda setup: setup.packet_history > 0,
        init=lambda start: packet_history.init(start.setup.packet_history),
        act=_remember_packet,
    ),
    "reaction": Stage(
        present=lambda setup: setup.reacts,
        init=lambda start: reaction.init(),
        act=_react,
        watch=_feel_cue,
        outcomes=lambda setup, state: {"reaction_ms": state.acted},
        moves_hands=True,
    ),
    "hand": Stage(
        present=lambda setup: setup.hand_yields,
        init=lambda start: for_each_arm(start.setup, hand.init(start.setup)),
        watch=_move_hand,
        outcomes=hand.outcomes,
        moves_hands=True,
    ),
    "channel": Stage(
        present=lambda setup: seeds_network(setup, "bursts"),
        init=lambda start: channel.init(),
        transmit=_lose_bursts,
    ),
    "detectors": Stage(
        present=lambda setup: bool(setup.detectors),
        init=lambda start: detectors.init(start.setup, start.params.detectors),  # type: ignore[arg-type]
        watch=_detect,
        outcomes=detectors.outcomes,
        early=True,
    ),
    "overload": Stage(
        present=lambda setup: setup.cables != "unwatched",
        init=lambda start: overload.init(start.setup),
        watch=_add_loads,
        outcomes=lambda setup, state: overload.outcomes(state),
        numbers=lambda state: {"cable": [state.peak]},
    ),
    "touch": Stage(
        present=lambda setup: setup.contact,
        init=lambda start: touch.init(start.setup),
        watch=_add_touches,
        outcomes=touch.outcomes,
        numbers=lambda state: {"contact": [state.impulse]},
    ),
    "restart": Stage(
        present=lambda setup: any(may_restart(*key) for key in channel_keys(setup)),
        init=lambda start: RestartState(jnp.bool_(False), jnp.int32(-1)),
        watch=_watch_restart,
        outcomes=lambda setup, state: {"restart_ms": state.first},
    ),
    "own_operator": Stage(
        present=lambda setup: setup.hands is not None,
        init=own_operator.init,
        act=own_operator.act_as_file,
        watch=own_operator.show_state,
        numbers=lambda state: {} if state.grasp is None else {"hand": [*state.grasp.offset]},
        moves_hands=True,
    ),
}
"""All optional stages, in the order in which they act."""
