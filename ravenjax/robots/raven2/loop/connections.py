"""What one part of the tick hands to the next, where the two do not speak the same words. No
state of its own.
"""

from __future__ import annotations

from typing import Any

from ravenjax.faults.injector import strikes
from ravenjax.numbers.lazy import jnp
from ravenjax.numbers.setup import per_arm, real
from ravenjax.numbers.vec import Scalar, Vec, record, replace, where
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console import operator, own_operator, reaction
from ravenjax.robots.raven2.geometry import kinematics, transmission
from ravenjax.robots.raven2.loop import control, guard
from ravenjax.robots.raven2.loop.arm_view import ArmView
from ravenjax.robots.raven2.plant import contact, nominal, nominal_target
from ravenjax.robots.raven2.plant import robot as plant
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.robots.raven2.stages import plc, usb
from ravenjax.stages import detectors, haptics


@record
class ConsoleSeam:
    """What a fault may change of the console."""

    scale: Scalar


@record
class Network:
    """What a fault may do to the newest packet on its way."""

    lag: Scalar  # int32 packets, sent again
    delay: Scalar  # int32 packets, of a channel that delivers in order
    lost: Scalar  # bool
    bursts: Scalar  # float, seed of the channel's losses; 0: none
    jitter: Scalar  # float, seed of the channel's delays; 0: none


@record
class PacketTiming:
    """A packet and where in the motion it is made."""

    index: Scalar  # int32
    row: Scalar  # int32, of the motion: what the hands do when it is made
    before: Scalar  # int32, the same of the packet before it: increments are since then


def row_by_row(index: Scalar) -> PacketTiming:
    """The packet of that index where each is made of the motion's next row, however long it
    lasts.
    """
    return PacketTiming(index, index, index - 1)


@record
class Buttons:
    """The buttons beside the robot: 1 pressed."""

    estop: Scalar  # bool
    start: Scalar  # bool


@record
class UsbStatus:
    """Whether USB transfers succeed, one entry an arm."""

    read_ok: tuple[Scalar, ...]
    write_ok: tuple[Scalar, ...]


def boards_apart(setup: RavenSetup) -> int:
    """USB boards whose output pins may differ: all are written alike, unless a write can fail or
    a board refuse.
    """
    return len(setup.arms) if strikes(setup, "usb_status") or guard.refuses(setup) else 1


def each(setup: RavenSetup, item: Any) -> tuple[Any, ...]:
    """The same for every arm."""
    return tuple(item for _ in setup.arms)


def packet(
    setup: RavenSetup,
    console: operator.OperatorParams,
    reacts: reaction.ReactionParams | None,
    motion: tuple[Any, ...],
    reacting: reaction.ReactionState | None,
    hands: operator.HandOffsets | None,
    timing: PacketTiming,
    deviation: own_operator.Deviation = own_operator.PLAN,
) -> Any:
    """The packet of that index, as `console` (the operator's own, or one that a fault struck)
    sends it.
    """

    def row(index: Scalar, offset: tuple[Vec, ...] | None) -> operator.MotionRow:
        if reacts is None or reacting is None:
            line = operator.lookup(motion, index)
        else:
            pace = reaction.pace(setup, reacts, reacting, index)
            line = operator.lookup(motion, index - pace.lag)
            line = replace(line, surgeon_mode=jnp.where(pace.released, 0, line.surgeon_mode))
        return line if offset is None else operator.moved(line, offset)

    now, before = (None, None) if hands is None else (hands.offset, hands.offset_before)
    lag, lag_before, grasp, grasp_before, lifted = deviation
    new = row(timing.row if lag is None else timing.row - lag, now)
    old = row(timing.before if lag_before is None else timing.before - lag_before, before)
    if grasp is not None and grasp_before is not None:
        new, old = operator.closed(new, grasp), operator.closed(old, grasp_before)
    if lifted is not None:
        new = replace(new, surgeon_mode=jnp.where(lifted, 0, new.surgeon_mode))
    return operator.packet(setup, console, new, old, timing.index + 1)


def clean(setup: RavenSetup, packet: Any, fresh: Scalar, i: int) -> nominal_target.Clean:
    """What the console asks of the nominal model: each increment once, also where a packet spans
    several cycles.
    """
    delta, quat, grasp = packet.delta[i], packet.quat[i], packet.grasp[i]
    if setup.console == "increments":
        delta, quat, grasp = where(
            fresh, (delta, quat, grasp), (Vec.full(3, 0), Vec((0.0, 0.0, 0.0, 1.0)), 0)
        )
    return nominal_target.Clean(delta, quat, grasp, packet.surgeon_mode)


def delayed(
    delay: Scalar, now: tuple[Vec, ...], before: tuple[tuple[Vec, ...], ...]
) -> tuple[Vec, ...]:
    """The commands that reach the motors in this tick."""
    arrives = now
    for ticks, then in enumerate(before, start=1):
        arrives = where(delay == ticks, then, arrives)
    return arrives


def motors(
    setup: RavenSetup, robots: tuple[plant.PlantOutput, ...]
) -> tuple[tuple[Vec, Vec], ...] | None:
    """What a dynamics-simulator build reads in place of encoders: motors 1-3 of each arm."""
    if setup.build == "robot":
        return None
    return tuple((Vec(out.mpos[:3]), Vec(out.mvel[:3])) for out in robots)


def tips(
    setup: RavenSetup,
    params: tuple[plant.PlantParams, ...],
    states: tuple[plant.PlantState, ...],
    robots: tuple[plant.PlantOutput, ...],
) -> tuple[Vec, ...]:
    """True tip of each arm, m in registered frame 0."""
    return per_arm(setup, lambda i, arm: plant.tip(arm, params[i], states[i], robots[i].jpos))


def touches(robots: tuple[plant.PlantOutput, ...]) -> tuple[contact.Touch, ...]:
    """What each instrument felt in this tick; none where nothing is touched."""
    return tuple(out.touch for out in robots if out.touch is not None)


def plant_signal(
    current_cmd: Vec, brakes: Scalar, multipliers: dict[str, tuple[Vec, ...]], i: int
) -> plant.PlantSignal:
    """What the i-th arm of the virtual robot gets; multipliers: of its mechanics, by site, where
    faults strike them.
    """
    return replace(
        plant.nominal_signal(current_cmd, brakes),
        **{site: arms[i] for site, arms in multipliers.items()},
    )


def brakes(setup: RavenSetup, signals: control.ControlSignals, relays: plc.PlcOutput) -> Scalar:
    """Brakes follow the PLC; the simulator builds of the 2015 fork have none."""
    return relays.brakes if setup.software == "raven2" else jnp.int32(0)


def measured(setup: RavenSetup, signals: control.ControlSignals) -> tuple[Vec, ...]:
    """Measured tip of each arm, whole um."""
    return tuple(real(setup, arm.pos.position_um) for arm in signals.arms)


def felt(
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


def watched(
    command_limit: Vec,
    signals: control.ControlSignals,
    robots: tuple[plant.PlantOutput, ...],
    cues: tuple[haptics.HapticOutput, ...],
    armed: Scalar,
    now: Scalar,
    views: tuple[ArmView, ...] | None,
) -> detectors.DetectorSignal:
    """What the detectors see."""
    return detectors.DetectorSignal(
        mpos=tuple(out.mpos for out in robots),
        mvel=tuple(out.mvel for out in robots),
        jpos=tuple(out.jpos for out in robots),
        jvel=tuple(out.jvel for out in robots),
        tip_error=tuple(out.distance for out in cues),
        command=tuple(arm.current_cmd for arm in signals.arms),
        command_limit=command_limit,
        armed=armed,
        tick=now,
        views=views,
    )


def views(
    setup: RavenSetup,
    packet: Any,
    signals: control.ControlSignals,
    boards: usb.UsbOut,
    brakes: Scalar,
    models: tuple[nominal.NominalOutput, ...],
    cues: tuple[haptics.HapticOutput, ...],
    now: Scalar,
) -> tuple[ArmView, ...]:
    """What parts of one's own see, one entry an arm."""

    def view(i: int, arm: ArmName) -> ArmView:
        own, model, cue = signals.arms[i], models[i], cues[i]
        return ArmView(
            received=packet.received,
            delta=packet.delta[i],
            grasp=packet.grasp[i],
            surgeon_mode=packet.surgeon_mode,
            tick=now,
            runlevel=signals.runlevel,
            **{name: real(setup, getattr(own, name)) for name in _FLOATS},
            **{name: getattr(own, name) for name in _COUNTS},
            pos=own.pos.position_um,
            pos_d=own.pos_d.position_um,
            boards_cmd=boards.current_cmd[i],
            brakes=brakes,
            model_jpos=model.jpos,
            model_tip=model.tip_position,
            tip=model.tip_position - cue.error,
            tip_error=cue.distance,
        )

    return per_arm(setup, view)


_FLOATS = ("mpos", "mvel", "jpos", "jvel", "jpos_d", "mpos_d", "tau_d")
_COUNTS = ("enc_val", "current_cmd", "current_cmd_checked", "current_cmd_written")
