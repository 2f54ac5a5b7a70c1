"""Observes the robot in each tick: nominal model, haptic cue, monitor.

They also run without the rest of the tick, if a real or remote robot sends its signals.
"""

from typing import Any, NamedTuple, TypeVar

from ravenjax.numbers import cast_to_real, for_each_arm, jnp, tree
from ravenjax.numbers.vec import Scalar, Vec, record, replace, where
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.geometry import kinematics, scene, transmission
from ravenjax.robots.raven2.loop.records import Input, TickParams, TickState
from ravenjax.robots.raven2.plant import nominal
from ravenjax.robots.raven2.setup import ArmName, PerArm, RavenSetup, map_arms
from ravenjax.stages import haptics, monitor


@record
class ObserverState:
    """State of the observers of a remote robot. In simulations, `TickState` has these fields."""

    nominal: PerArm[nominal.NominalState]
    haptics: PerArm[haptics.HapticState]
    monitor: monitor.MonitorState


class RobotView(NamedTuple):
    """The signals of the robot that the observers read in this tick."""

    jpos: PerArm[Vec]  # rad; insertion m, as the control software estimates them
    mvel: PerArm[Vec]  # rad/s, of the motors
    runlevel: Scalar  # int32
    soft_estopped: Scalar  # int32 flag
    dac: PerArm[Vec]  # counts, as written to USB
    pos: PerArm[Vec] | None = None  # um, measured tip; None: the tip of `jpos`
    tips: PerArm[Vec] | None = None  # m, true tips; None: the reported tips


Observed = TypeVar("Observed", TickState, ObserverState)


class Observations(NamedTuple):
    """Results of the observers in this tick."""

    models: PerArm[nominal.NominalOutput]
    cues: PerArm[haptics.HapticOutput]
    tips: PerArm[Vec]  # m, true tip in frame 0; the reported tip if the true one is unknown
    depth: PerArm[Scalar]  # m below the tissue's surface, negative above
    distance: Scalar  # m between the tips; infinite with one arm
    live: Scalar  # bool, see `is_live`


def init(
    setup: RavenSetup, params: TickParams, start: PerArm[Vec], tips: PerArm[Vec]
) -> ObserverState:
    """Return the observers' state for a robot at rest. start: joints, rad and m; tips: true, m."""
    return ObserverState(
        nominal=map_arms(setup, nominal.init, params.nominal, start),
        haptics=for_each_arm(setup, haptics.init(setup, params.haptics)),
        monitor=monitor.init(setup, tips, _to_um(tips)),
    )


def update_model_and_cue(
    setup: RavenSetup,
    params: TickParams,
    state: Observed,
    clean: Packet,
    fresh: Scalar,
    robot: RobotView,
) -> tuple[Observed, Observations]:
    """Return the state after a tick of the nominal model and of the haptic cue, and their results.
    clean: newest packet of the console, before faults. fresh: whether the packet was sent in this
    tick, bool.
    """

    def sense(
        setup: RavenSetup, arm: ArmName, tool: str, model, device, jpos: Vec, mvel: Vec
    ) -> tuple[Any, ...]:
        """Return the reported tip (m), the state of the haptic device, and the cue of one arm."""
        jvel = transmission.joint_from_motor(
            arm, tool, cast_to_real(setup, mvel), software=setup.software
        )
        jvel = cast_to_real(setup, jvel)
        tip = kinematics.forward_pose(arm, jpos).position
        signal = haptics.HapticSignal(
            model.tip_position, model.tip_velocity, tip, kinematics.tip_velocity(arm, jpos, jvel)
        )
        return tip, *haptics.step(setup, params.haptics, device, signal)

    def clean_command(*command) -> nominal.Clean:
        # Returns the operator's command to one arm, without motion if the packet is old.
        if setup.console == "increments":
            # A packet may last several cycles, and its increments count only in the first
            no_motion = (Vec.full(3, 0), Vec((0.0, 0.0, 0.0, 1.0)), 0)
            command = where(fresh, command, no_motion)
        return nominal.Clean(*command, engaged=clean.surgeon_mode)

    commands = tuple(map(clean_command, clean.delta, clean.quat, clean.grasp))
    jpos = cast_to_real(setup, robot.jpos)
    stepped = map_arms(setup, nominal.step, params.nominal, state.nominal, commands, jpos)
    model_states, models = zip(*stepped, strict=True)
    sensed_arms = map_arms(setup, sense, setup.tools, models, state.haptics, jpos, robot.mvel)
    reported, device_states, cues = zip(*sensed_arms, strict=True)
    tips = reported if robot.tips is None else robot.tips
    return replace(state, nominal=model_states, haptics=device_states), Observations(
        models,
        cues,
        tips,
        tuple(map(scene.tissue_depth, setup.arms, tips)),
        scene.tip_distance(setup.arms, tips),
        is_live(robot.runlevel, robot.soft_estopped),
    )


def update_monitor(
    setup: RavenSetup,
    params: TickParams,
    state: monitor.MonitorState,
    clean: Packet,
    fresh: Scalar,
    robot: RobotView,
    observations: Observations,
    golden: Input | None,
    now: Scalar,
) -> monitor.MonitorState:
    """Return the state of the monitor after a tick. Call it after `update_model_and_cue`.
    observations: results of `update_model_and_cue`. golden: inputs with the golden run, with which
    the monitor compares the robot; None: it compares with the nominal model. now: the tick.
    """
    model_tips = tuple(out.tip_position for out in observations.models)
    pos = _to_um(observations.tips) if robot.pos is None else cast_to_real(setup, robot.pos)
    signal = monitor.MonitorSignal(
        tip=observations.tips,
        pos=pos,
        model_tip=model_tips,
        depth=observations.depth,
        distance=observations.distance,
        dac=robot.dac,
        fresh=fresh,
        live=observations.live,
        pedal=clean.surgeon_mode != 0,
        tick=now,
    )
    reference = monitor.Reference(model_tips, _to_um(model_tips))
    if golden is not None:
        reference = golden_reference(setup, golden, observations.tips, pos)
    return monitor.step(setup, params.monitor, state, signal, reference)


def is_live(runlevel: Scalar, soft_estopped: Scalar) -> Scalar:
    """Return whether the robot is live: in pedal-down without a software E-stop."""
    return (runlevel == run_levels.PEDAL_DOWN) & (soft_estopped == 0)


def golden_reference(
    setup: RavenSetup, signal: Input, tips: PerArm[Vec], pos: PerArm[Vec]
) -> monitor.Reference:
    """Return true and reported tips of the golden run in this tick. tips: m; pos: um. Before a
    fault acts, the golden run equals the robot, so the result is `tips` and `pos`.
    """
    if signal.apart is None:  # the reference is the golden run in every tick
        return signal.reference
    return tree.map_leaves(
        lambda golden, robot: jnp.where(signal.apart, golden, cast_to_real(setup, robot)),
        signal.reference,
        monitor.Reference(tips, pos),
    )


def _to_um(tips: PerArm[Vec]) -> PerArm[Vec]:
    return tuple(tip * 1e6 for tip in tips)
