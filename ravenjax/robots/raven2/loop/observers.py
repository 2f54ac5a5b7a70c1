"""Observes the robot in each tick: nominal model, haptic cue, monitor.

The observers also run without the rest of the tick, beside a remote robot that only sends reports.
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
    """State of the observers next to a remote robot. In simulations it is part of `TickState`."""

    nominal: PerArm[nominal.NominalState]
    haptics: PerArm[haptics.HapticState]
    monitor: monitor.MonitorState


class RobotSignals(NamedTuple):
    """The signals of the robot that the observers read in this tick."""

    jpos: PerArm[Vec]  # rad; insertion m, as the control software has them
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
    live: Scalar  # bool


def init(setup: RavenSetup, start: PerArm[Vec], tips: PerArm[Vec]) -> ObserverState:
    """Return the observers of a robot at rest. start: 7 joints, rad and m. tips: true tips, m."""
    return ObserverState(
        nominal=map_arms(setup, nominal.init, start),
        haptics=for_each_arm(setup, haptics.init(setup)),
        monitor=monitor.init(setup, tips, _to_um(tips)),
    )


def update_model_and_cue(
    setup, params: TickParams, state: Observed, clean: Packet, fresh: Scalar, robot: RobotSignals
) -> tuple[Observed, Observations]:
    """Compute one tick of the nominal model and of the haptic cue.
    clean: newest packet of the console, before faults. fresh: whether it was sent in this tick.
    """

    def compute_cue(
        setup: RavenSetup, arm: ArmName, tool: str, model, device_state, jpos: Vec, mvel: Vec
    ) -> tuple[Any, ...]:
        """Return the reported tip, the new state of the haptic device, and the cue of one arm."""
        mvel = cast_to_real(setup, mvel)
        jvel = transmission.joint_from_motor(arm, tool, mvel, setup.software)
        tip = kinematics.forward_pose(arm, jpos).position
        model_motion = model.tip_position, model.tip_velocity
        motion = tip, kinematics.tip_velocity(arm, jpos, jvel)
        return tip, *haptics.step(params.haptics, device_state, *model_motion, *motion)

    def make_command(*command) -> nominal.Command:
        # Returns the command for the nominal model of one arm.
        # command: translation, quaternion and jaw motion of the arm in the packet.
        if setup.console == "increments":
            # A packet may last several cycles, and its increments count only in the first.
            no_motion = Vec.full(3, 0), Vec((0.0, 0.0, 0.0, 1.0)), 0
            command = where(fresh, command, no_motion)
        return nominal.Command(*command, engaged=clean.surgeon_mode)

    commands = tuple(map(make_command, clean.delta, clean.quat, clean.grasp))
    jpos = cast_to_real(setup, robot.jpos)
    stepped = map_arms(setup, nominal.step, params.nominal, state.nominal, commands, jpos)
    model_states, models = zip(*stepped, strict=True)
    with_cues = map_arms(setup, compute_cue, setup.tools, models, state.haptics, jpos, robot.mvel)
    reported_tips, device_states, cues = zip(*with_cues, strict=True)
    tips = reported_tips if robot.tips is None else robot.tips
    return replace(state, nominal=model_states, haptics=device_states), Observations(
        models=models,
        cues=cues,
        tips=tips,
        depth=tuple(map(scene.tissue_depth, setup.arms, tips)),
        distance=scene.tip_distance(setup.arms, tips),
        live=is_live(robot.runlevel, robot.soft_estopped),
    )


def update_monitor(
    setup: RavenSetup,
    params: TickParams,
    state: monitor.MonitorState,
    clean: Packet,
    fresh: Scalar,
    robot: RobotSignals,
    observed: Observations,
    golden: Input | None,
    tick: Scalar,
) -> monitor.MonitorState:
    """Return the monitor's state after this tick, in which `update_model_and_cue` gave `observed`.
    clean: newest packet, before faults. fresh: bool, it was sent in this tick. golden: input of the
    tick with the golden run; None: the monitor compares with the nominal model instead.
    """
    model_tips = tuple(out.tip_position for out in observed.models)
    pos = _to_um(observed.tips) if robot.pos is None else cast_to_real(setup, robot.pos)
    signal = monitor.MonitorSignal(
        tip=observed.tips,
        pos=pos,
        model_tip=model_tips,
        depth=observed.depth,
        distance=observed.distance,
        dac=robot.dac,
        fresh=fresh,
        live=observed.live,
        pedal=clean.surgeon_mode != 0,
        tick=tick,
    )
    reference = monitor.Reference(model_tips, _to_um(model_tips))
    if golden is not None:
        reference = golden_reference(setup, golden, observed.tips, pos)
    return monitor.step(setup, params.monitor, state, signal, reference)


def is_live(runlevel: Scalar, soft_estopped: Scalar) -> Scalar:
    """Return whether the robot is live: in pedal-down without a software E-stop."""
    return (runlevel == run_levels.PEDAL_DOWN) & (soft_estopped == 0)


def golden_reference(
    setup: RavenSetup, signal: Input, tips: PerArm[Vec], pos: PerArm[Vec]
) -> monitor.Reference:
    """Return the tips of the golden run in this tick.
    tips, pos: true tips (m) and measured tips (um) of the robot, which is its own golden run until
    a fault acts. `signal.golden_differs` tells this in training sessions; it is None in campaigns.
    """
    if signal.golden_differs is None:
        return signal.reference
    return tree.map_leaves(
        lambda golden, robot: jnp.where(signal.golden_differs, golden, cast_to_real(setup, robot)),
        signal.reference,
        monitor.Reference(tips, pos),
    )


def _to_um(tips: PerArm[Vec]) -> PerArm[Vec]:
    return tuple(tip * 1e6 for tip in tips)
