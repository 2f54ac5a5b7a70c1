"""The half of the tick beside the robot: the nominal model on the clean packet, the console's cue,
the monitor.

It runs in every tick, and alone where the robot is elsewhere and no more is known of it than it
reports.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from ravenjax.numbers import tree
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import per_arm, real
from ravenjax.numbers.vec import Scalar, Vec, record, replace, where
from ravenjax.robots.raven2 import run_levels
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console.packet import Packet
from ravenjax.robots.raven2.geometry import kinematics, scene, transmission
from ravenjax.robots.raven2.plant import nominal
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import haptics, monitor


class ObserverParams(NamedTuple):
    """Of each observer; what a campaign may vary of them stands in the tick's."""

    nominal: tuple[nominal.NominalParams, ...]
    haptics: haptics.HapticParams
    monitor: monitor.MonitorParams


@record
class ObserverState:
    """What the observers remember, one entry an arm."""

    nominal: tuple[nominal.NominalState, ...]
    haptics: tuple[haptics.HapticState, ...]
    monitor: monitor.MonitorState


class RobotView(NamedTuple):
    """What is known of the robot in this tick, one entry an arm."""

    jpos: tuple[Vec, ...]  # rad; insertion m, as its control software has them
    mvel: tuple[Vec, ...]  # rad/s, of its motors
    runlevel: Scalar  # int32
    soft_estopped: Scalar  # int32 flag
    dac: tuple[Vec, ...]  # counts, as written to USB
    pos: tuple[Vec, ...] | None = None  # um, measured tip; None: that of `jpos`
    tips: tuple[Vec, ...] | None = None  # m, true tips; None: as reported


class Golden(NamedTuple):
    """What the robot is compared with."""

    reference: monitor.Reference  # its golden run in this tick
    apart: Scalar | None = (
        None  # bool, False: nothing has struck yet, the robot is its own golden run; None: True
    )


class Seen(NamedTuple):
    """What the observers make of this tick, one entry an arm."""

    models: tuple[nominal.NominalOutput, ...]
    cues: tuple[haptics.HapticOutput, ...]
    tips: tuple[Vec, ...]  # m, true tip in frame 0; where nobody knows it the reported one
    depth: tuple[Scalar, ...]  # m below the tissue's surface, negative above
    distance: Scalar  # m between the tips; infinite with one arm
    live: Scalar  # bool


def init(
    setup: RavenSetup, params: ObserverParams, start: tuple[Vec, ...], tips: tuple[Vec, ...]
) -> ObserverState:
    """Beside a robot at rest: its joints (rad; insertion m) and its true tips (m)."""
    return ObserverState(
        nominal=per_arm(
            setup, lambda i, arm: nominal.init(setup, arm, params.nominal[i], start[i])
        ),
        haptics=per_arm(setup, lambda i, arm: haptics.init(setup, params.haptics)),
        monitor=monitor.init(setup, tips, _um(tips)),
    )


def observe(
    setup: RavenSetup,
    params: ObserverParams,
    state: ObserverState,
    clean: Packet,
    fresh: Scalar,
    robot: RobotView,
    golden: Golden | None,
    now: Scalar,
) -> tuple[ObserverState, Seen]:
    """One tick of the observers: `see`, then `judge`."""
    after, signals = see(setup, params, state, clean, fresh, robot)
    return (
        replace(
            after, monitor=judge(setup, params, state, clean, fresh, robot, signals, golden, now)
        ),
        signals,
    )


def see(
    setup: RavenSetup,
    params: ObserverParams,
    state: ObserverState,
    clean: Packet,
    fresh: Scalar,
    robot: RobotView,
) -> tuple[ObserverState, Seen]:
    """One tick of the nominal model and the cue; the monitor is as before.

    clean: the newest packet as the console meant it, whatever became of it; `fresh` where it is of
    this tick.
    """
    models = per_arm(
        setup,
        lambda i, arm: nominal.step(
            setup,
            arm,
            params.nominal[i],
            state.nominal[i],
            _clean(setup, clean, fresh, i),
            real(setup, robot.jpos[i]),
        ),
    )
    felt, cues = zip(
        *per_arm(setup, lambda i, arm: _cue(setup, params, state, models, robot, i, arm)),
        strict=True,
    )
    tips = tuple(signal.robot_position for signal in felt) if robot.tips is None else robot.tips
    depth = per_arm(setup, lambda i, arm: scene.tissue_depth(arm, tips[i]))
    distance = scene.tip_distance(setup.arms, tips)
    after = ObserverState(
        tuple(new for new, _ in models), tuple(new for new, _ in cues), state.monitor
    )
    outs = tuple(out for _, out in models), tuple(out for _, out in cues)
    return after, Seen(*outs, tips, depth, distance, live(robot.runlevel, robot.soft_estopped))


def judge(
    setup: RavenSetup,
    params: ObserverParams,
    state: ObserverState,
    clean: Packet,
    fresh: Scalar,
    robot: RobotView,
    signals: Seen,
    golden: Golden | None,
    now: Scalar,
) -> monitor.MonitorState:
    """The monitor after a tick. golden: None where there is no golden run; the nominal model
    stands for it.
    """
    tips, model_tips = signals.tips, tuple(out.tip_position for out in signals.models)
    pos = _um(tips) if robot.pos is None else real(setup, robot.pos)
    signal = monitor.MonitorSignal(
        tip=tips,
        pos=pos,
        model_tip=model_tips,
        depth=signals.depth,
        distance=signals.distance,
        dac=robot.dac,
        fresh=fresh,
        live=signals.live,
        pedal=clean.surgeon_mode != 0,
        tick=now,
    )
    beside = (
        monitor.Reference(model_tips, _um(model_tips))
        if golden is None
        else reference(setup, golden, tips, pos)
    )
    return monitor.step(setup, params.monitor, state.monitor, signal, beside)


def live(runlevel: Scalar, soft_estopped: Scalar) -> Scalar:
    """Whether the robot is live, as `ravenjax.outcomes` says: run level pedal-down, no software
    E-stop.
    """
    return (runlevel == run_levels.PEDAL_DOWN) & (soft_estopped == 0)


def reference(
    setup: RavenSetup, golden: Golden, tips: tuple[Vec, ...], pos: tuple[Vec, ...]
) -> monitor.Reference:
    """The golden run, or the robot itself (true tips, m; measured tips, um) as long as they are
    the same.
    """
    beside, apart = golden
    if apart is None:
        return beside
    own = monitor.Reference(tips, pos)
    return tree.mapped(lambda there, here: jnp.where(apart, there, real(setup, here)), beside, own)


def _um(tips: tuple[Vec, ...]) -> tuple[Vec, ...]:
    """Metres in micrometres."""
    return tuple(tip * 1e6 for tip in tips)


def _cue(
    setup: RavenSetup,
    params: ObserverParams,
    state: ObserverState,
    models: tuple[tuple[nominal.NominalState, nominal.NominalOutput], ...],
    robot: RobotView,
    i: int,
    arm: ArmName,
) -> tuple[haptics.HapticSignal, tuple[haptics.HapticState, haptics.HapticOutput]]:
    """What the console compares, and the cue after it."""
    felt = _felt(setup, arm, i, models[i][1], robot.jpos[i], robot.mvel[i])
    return felt, haptics.step(setup, params.haptics, state.haptics[i], felt)


def _clean(setup: RavenSetup, packet: Any, fresh: Scalar, i: int) -> nominal.Clean:
    """What the console asks of the nominal model: each increment once, also where a packet spans
    several cycles.
    """
    delta, quat, grasp = packet.delta[i], packet.quat[i], packet.grasp[i]
    if setup.console == "increments":
        delta, quat, grasp = where(
            fresh, (delta, quat, grasp), (Vec.full(3, 0), Vec((0.0, 0.0, 0.0, 1.0)), 0)
        )
    return nominal.Clean(delta, quat, grasp, packet.surgeon_mode)


def _felt(
    setup: RavenSetup, arm: ArmName, i: int, model: nominal.NominalOutput, jpos: Vec, mvel: Vec
) -> haptics.HapticSignal:
    """What the console compares: the nominal model and the robot as its control software reports
    joints and motors.
    """
    jpos, mvel = real(setup, (jpos, mvel))
    jvel = real(
        setup, transmission.joint_from_motor(arm, setup.tools[i], mvel, software=setup.software)
    )
    position = kinematics.forward(arm, jpos).position
    return haptics.HapticSignal(
        model.tip_position, model.tip_velocity, position, kinematics.tip_velocity(arm, jpos, jvel)
    )
