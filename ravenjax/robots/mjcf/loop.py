"""One tick of an arm from an MJCF file: packet, sense, check, control, move, watch.

The set points of the operator arrive in packets and are clipped to the joints' ranges. The
controller is the model's own actuators, with the torques that hold the arm against gravity added.
An actuator of type <motor> gets a PD controller. After a check has stopped the arm, brakes slow it.

The nominal model is the same arm, moved by the operator's set points, without faults and checks.
Its controller balances all of gravity. The arm's controller balances the share `gravity` of it.

This module implements the protocol `ravenjax.engines.interface.Loop`.
"""

import copy
import dataclasses
from functools import reduce
from operator import or_
from typing import Any, Literal

from ravenjax.faults import fault
from ravenjax.faults.injection import Injector, channel_paths
from ravenjax.mechanics import mechanism
from ravenjax.numbers import cast_to_real, describe_fields, jnp, setup
from ravenjax.numbers.algebra import minus, mul, plus
from ravenjax.numbers.vec import Scalar, Vec, as_int, clamp, record, replace, where
from ravenjax.parts import part
from ravenjax.robots.mjcf import Arm
from ravenjax.stages import check, detectors, haptics, monitor
from ravenjax.stages.monitor import series_length as series_length


@dataclasses.dataclass(frozen=True)
class ArmSetup(setup.Setup):
    """Everything that selects the code of the tick."""

    robot: Any = None  # ArmRobot
    # what moves the links: printed equations, or in engine mjx a step of MuJoCo MJX
    link_dynamics: Literal["unrolled", "mjx"] = "unrolled"

    @property
    def joints(self) -> tuple[str, ...]:  # type: ignore[override]
        """Names of the joints, in order."""
        return self.robot.joints

    @property
    def period_ms(self) -> int:  # type: ignore[override]
        """Duration of a tick."""
        return self.robot.period_ms


UNLIMITED = 1e9
"""Limit of a check that never trips."""


@describe_fields
@record
class Params:
    """What a campaign may vary."""

    start: Vec  # rad or m
    lower: Vec
    upper: Vec
    tracking: Vec
    velocity: Vec
    watchdog: Scalar
    sensor: Vec
    sensor_ms: Scalar
    effort: Vec
    effort_ms: Scalar
    kp: Vec
    kd: Vec
    gravity: Scalar
    coasting: Scalar
    detectors: detectors.WatchParams
    haptics: haptics.HapticParams
    monitor: monitor.MonitorParams
    # of an action: (whether the controller keeps set points, these); None: without actions
    held: Any = None


@record
class Packet:
    """What the operator sends."""

    goal: Vec  # set points, rad or m
    lost: Scalar  # bool


@record
class State:
    """What is remembered from one tick to the next."""

    faults: fault.FaultState
    jpos: Vec  # rad or m
    jvel: Vec  # rad/s or m/s
    goal: Vec  # newest set points that arrived
    silent: Scalar  # int32 ticks since they arrived
    differ: Scalar  # int32 ticks in a row in which second sensor and encoder differ
    strained: Scalar  # int32 ticks in a row with a large force
    command: Vec
    reported: Vec
    model: tuple[Vec, Vec]  # positions and velocities of the nominal model
    plan: Vec  # set points of the operator
    tips: tuple[Vec, Vec]  # m, reported and nominal
    stopped: Scalar  # bool
    checks: tuple[check.CheckHistory, ...]  # in the order of the robot's
    detectors: detectors.DetectorsState
    haptics: haptics.HapticState
    monitor: monitor.MonitorState
    live: Scalar  # int32 ticks


def init(setup: ArmSetup, params: Params) -> State:
    """Return the state at rest at the start of the motion."""
    jpos, zero = cast_to_real(setup, params.start), jnp.int32(0)
    tip = mechanism.tip_position(setup.robot.arm.mechanism, jpos)
    return State(
        faults=fault.init(setup),
        **dict.fromkeys(("jpos", "goal", "command", "reported", "plan"), jpos),
        **dict.fromkeys(("silent", "differ", "strained", "live"), zero),
        jvel=jpos * 0.0,
        model=(jpos, jpos * 0.0),
        tips=(tip, tip),
        stopped=jnp.bool_(False),
        checks=(check.init(setup),) * len(setup.robot.checks),
        detectors=detectors.init(setup, params.detectors),
        haptics=haptics.init(setup),
        # True tip in m, and measured tip in um.
        monitor=monitor.init(setup, (tip,), (tip * 1e6,)),
    )


def advance(
    setup: ArmSetup, params: Params, faults: fault.Faults, state: State, now: Scalar, motion, golden
) -> tuple[State, tuple[Scalar, ...], dict[str, Any]]:
    """Compute one tick; see `ravenjax.engines.interface.Loop`."""
    arm = setup.robot.arm
    ms = arm.period_ms
    clocks = fault.TriggerClocks(now, now + 1, now)
    opened = fault.open_windows(setup, faults, state.faults, clocks)
    inject = make_injector(setup, faults, opened, clocks)
    usual, params = params, inject.inject_parameters(params)

    plan = Vec(cast_to_real(setup, column[now]) for column in motion)
    (packet,) = inject("packet", (Packet(plan, jnp.bool_(False)),))
    goal = where(packet.lost, state.goal, packet.goal)
    silent = jnp.where(packet.lost, state.silent + 1, 0)
    (reported,) = inject("encoder", (state.jpos,))
    (second,) = inject("sensor", (state.jpos,))
    differ = _count(state.differ, second - reported, params.sensor)
    (command,) = inject("command", (goal.map(clamp, params.lower, params.upper),))
    if params.held is not None:
        holds, good = params.held
        command = where(holds, good, command)
    margins = (
        _least(params.tracking - (command - reported).map(jnp.abs)),
        _least(params.velocity - ((reported - state.reported) * (1e3 / ms)).map(jnp.abs)),
        params.watchdog - cast_to_real(setup, silent * ms),
        params.sensor_ms - cast_to_real(setup, differ * ms),
        params.effort_ms - cast_to_real(setup, state.strained * ms),
        _least((*(goal - params.lower), *(params.upper - goal))),
    )
    *stops, clips = (~(margin >= 0.0) for margin in margins)
    stops = [trips & ~state.stopped for trips in stops]
    stopped = reduce(or_, stops, state.stopped)

    torque = _control(arm, params, params.gravity, reported, state.jvel, command, state.command)
    torque = where(stopped, torque * 0.0, torque)
    # The share of an actuator's gains that acts depends on the fault: none if it overwrites.
    _, more = _drive(copy.copy(inject), arm, torque + 1.0)
    driven, exerted = _drive(inject, arm, torque)
    gain_share = Vec(
        jnp.where(x == t, 1.0, jnp.clip(y - x, 0.0, 1.0))
        for x, t, y in zip(exerted, torque, more, strict=True)
    )
    step = mechanism.step if setup.link_dynamics == "unrolled" else mechanism.step_by_mjx
    jpos, jvel = _move(step, arm, params, (state.jpos, state.jvel), exerted, gain_share)
    slower = state.jvel * params.coasting**ms
    jvel = where(stopped, slower, jvel)
    jpos = where(stopped, state.jpos + slower * (1e-3 * ms), jpos)

    wanted, before = (x.map(clamp, usual.lower, usual.upper) for x in (plan, state.plan))
    ideal = _control(arm, usual, 1.0, *state.model, wanted, before).map(clamp, *arm.force)
    follows = _move(mechanism.step, arm, usual, state.model, ideal, 1.0)
    tip, seen, model = (
        mechanism.tip_position(arm.mechanism, joints) for joints in (jpos, reported, follows[0])
    )
    rate = 1e3 / ms
    seen_way, model_way = ((a - b) * rate for a, b in zip((seen, model), state.tips, strict=True))
    # Encoders were read at the start of the tick, so the cue compares the model's tip of then.
    cue, pull = haptics.step(
        params.haptics, state.haptics, state.tips[1], model_way, seen, seen_way
    )
    running, always = ~stopped, jnp.bool_(True)
    infinite, nothing = cast_to_real(setup, jnp.inf), (Vec.full(len(jpos), 0),)
    watched = monitor.MonitorSignal(
        *((tip,), (seen * 1e6,), (model,), (-infinite,), infinite, nothing),
        *(always, running, always, now),
    )
    reference = monitor.reference_from(setup, golden)
    view = {"tick": now, "jpos": reported, "jpos_d": command, "tau_d": driven}
    watching = detectors.WatchSignal(running, now, (part.View("the end", view),))
    histories = zip(state.checks, (*stops, clips), margins, strict=True)
    new = State(
        *(inject.state, jpos, jvel, goal, silent, differ),
        *(_count(state.strained, exerted, params.effort), command, reported),
        *(follows, plan, (seen, model), stopped),
        checks=tuple(check.update_check(old, now, trips, m) for old, trips, m in histories),
        detectors=detectors.step(setup, params.detectors, state.detectors, watching),
        haptics=cue,
        monitor=monitor.step(setup, params.monitor, state.monitor, watched, reference),
        live=state.live + as_int(running),
    )
    seams = packet, reported, second, command, driven, exerted
    of_arm = {
        **dict(zip(setup.robot.seams, seams, strict=True)),
        "link_jpos": jpos,
        "link_jvel": jvel,
        "tip": tip,
        "position": seen,
        "model_position": model,
        "model_jpos": follows[0],
        "haptics": pull,
    }
    signals = {name: (signal,) for name, signal in of_arm.items()} | {
        "runlevel": as_int(running),
        "live": running,
        "fault_active": tuple(slot.active for slot in inject.state.slots),
        "detectors": new.detectors,
    }
    return new, monitor.reference_series((tip,), (seen * 1e6,)), signals


def _drive(inject: Injector, arm: Arm, torque: Vec) -> tuple[Vec, Vec]:
    """Return the forces as commanded and as exerted."""
    (driven,) = inject("torque", (torque,))
    (exerted,) = inject("actuator", (driven.map(clamp, *arm.force),))
    return driven, exerted


def _move(
    step, arm: Arm, params: Params, before: tuple[Vec, Vec], force: Vec, gain_share: Vec | float
) -> tuple[Vec, Vec]:
    """Return positions and velocities after a tick. force: of the actuators at the start of the
    tick. In each step, a servo changes its force with position and velocity, as in MuJoCo.
    gain_share: share of the gains of servos that acts, 0 to 1.
    """
    _, *gains = _gains(arm, params)
    # `step` applies the damping to changes of velocity within a time step. `lost_force` is the
    # force that the servos lost by motion in the earlier time steps of the tick.
    stiffness, damping = (gain.map(mul, gain_share) for gain in gains)
    after = step(arm.mechanism, *before, force, damping)
    for _ in range(arm.steps - 1):
        position_change, velocity_change = map(minus, after, before)
        lost_force = plus(stiffness.map(mul, position_change), damping.map(mul, velocity_change))
        after = step(arm.mechanism, *after, minus(force, lost_force), damping)
    return after


def _control(
    arm: Arm, params: Params, gravity_share, jpos: Vec, jvel: Vec, command: Vec, before: Vec
) -> Vec:
    """Return the forces of the actuators, without limits: gain strength control + bias - stiffness
    position - damping velocity, plus `gravity_share` (0 to 1) of the forces that balance gravity.
    before: command of the last tick.
    """

    def control_of(kind: str, position, velocity, goal, last_goal, kp, kd) -> Scalar:
        # Returns the input of an actuator: a position, a velocity, or for a motor a force.
        if kind == "position":
            return goal
        correction = (goal - position) * kp
        if kind == "velocity":
            return correction + (goal - last_goal) * (1e3 / arm.period_ms)
        return correction + velocity * -kd

    control = Vec(map(control_of, arm.kinds, jpos, jvel, command, before, params.kp, params.kd))
    strength, stiffness, damping = _gains(arm, params)
    force = plus(arm.gain.map(mul, strength).map(mul, control.map(clamp, *arm.control)), arm.bias)
    force = minus(minus(force, stiffness.map(mul, jpos)), damping.map(mul, jvel))
    weight = mechanism.gravity_torque(arm.mechanism, jpos)
    # A joint without an actuator has no force: a zero of the type of the others.
    return Vec(
        f + mul(gravity_share, w) if kind else 0.0 * w
        for kind, f, w in zip(arm.kinds, force, weight, strict=True)
    )


def _gains(arm: Arm, params: Params) -> list[Vec]:
    """Return the gains of the actuators' forces: of the control, the position and the velocity."""
    # The gains kp and kd of a motor are already part of its control, a PD controller's force.
    rows = (
        {"position": (kp, kp, kd), "velocity": (kd, 0.0, kd)}.get(kind, (1.0, 0.0, 0.0))
        for kind, kp, kd in zip(arm.kinds, params.kp, params.kd, strict=True)
    )
    return [Vec(column) for column in zip(*rows, strict=True)]


def _least(numbers: tuple[Scalar, ...]) -> Scalar:
    return reduce(jnp.minimum, numbers)


def _count(before: Scalar, numbers: Vec, limits: Vec) -> Scalar:
    """Return the ticks in a row in which a number has been beyond its limit."""
    within = _least(limits - numbers.map(jnp.abs)) >= 0.0
    return jnp.where(within, 0, before + 1)


def check_histories(setup: ArmSetup, state: State) -> dict[str, check.CheckHistory]:
    """Return every check by its name in columns."""
    return dict(zip(setup.robot.checks, state.checks, strict=True))


def outcomes(setup: ArmSetup, params: Params, state: State) -> dict[str, Scalar]:
    """Return the columns of the result table before the verdict."""
    out = {"end_runlevel": as_int(~state.stopped), "pedal_down_ms": state.live}
    out |= fault.outcomes(state.faults) | check.outcomes(check_histories(setup, state))
    out |= detectors.outcomes(setup, state.detectors)
    return out | haptics.outcomes(setup, (state.haptics,)) | monitor.outcomes(setup, state.monitor)


def make_injector(setup: ArmSetup, faults: Any, state: Any, clock: Any) -> Injector:
    """See `ravenjax.engines.interface.Loop`."""
    return Injector(setup, channel_paths(setup.robot, setup), faults, state, clock)


def name_signals(setup: ArmSetup, signals: dict[str, Any]) -> dict[str, Any]:
    """Return every signal by its name."""
    return signals


ACTIONS = ("stop", "hold")
"""Names of the actions that `ravenjax deadline` tries; see `stages.acted`."""


def last_command(state: State) -> Vec:
    """Return the set points of the controller, rad or m."""
    return state.command


def act(
    params: Params, state: State, now: Scalar, takes: dict[str, Scalar], begins: Scalar, good: Vec
) -> tuple[Params, State]:
    """Return parameters and state with the action: stop the arm, or keep the last good set points.

    takes: for each action, whether it has been taken. good: last set points from before the fault's
    first effect. now and begins: not used; other robots have actions that depend on time.
    """
    stopped = state.stopped | takes["stop"]
    return replace(params, held=(takes["hold"], good)), replace(state, stopped=stopped)
