"""Runs a user's file as the operator: what the file sees, and how its hands change the plan.

The plan is the motion that a campaign names. docs/how-to/own-operator.md lists what the file gets
in each millisecond, and the keys delta, grasp, pedal and pace that it may return. If a hand moves
differently than planned, the difference remains (`operator.HandOffsets`) until the file reverses
it. The robot and the nominal model both follow the hand. A file cannot change the hand's rotation.
It returns the same keys in all milliseconds. A key that is missing or unchanged adds no
computation.
"""

from collections.abc import Sequence
from typing import Any

from ravenjax.numbers import cast_to_real, for_each_arm, jnp, lax
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, replace, where
from ravenjax.parts import part
from ravenjax.parts.part import InPlace, View
from ravenjax.robots.raven2.console import operator
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.mapping import position_to_itp
from ravenjax.robots.raven2.loop.records import Console, Sight, Start
from ravenjax.robots.raven2.setup import ArmName, PerArm, RavenSetup
from ravenjax.stages import haptics


@record
class ScreenView:
    """What the operator sees and feels of an arm, in the console's axes, from the arm's base."""

    tip: Vec  # 3 m, true tip, as the camera shows it
    model_tip: Vec  # 3 m, tip of the nominal model
    pull: Vec  # 3 device units, force of the first haptic set
    force: Scalar  # device units, magnitude of that force; above 0 the cue is shown


@record
class OwnPace:
    """How far the hands are behind the plan, in rows of the plan."""

    part: Scalar  # fraction of a row, in addition to `lag`
    lag: Scalar  # int32, the lag now
    before: Scalar  # int32, the lag when the plan last continued
    sent: Scalar  # int32, the lag in the newest packet


@record
class OwnGrasp:
    """How far the hands are closed beyond the plan, mrad."""

    offset: PerArm[Scalar]
    sent: PerArm[Scalar]  # the value in the newest packet


@record
class OwnOperatorState:
    """State of a user's operator; None for a key that the file does not return."""

    own: Any  # the state that the file's `init` returned
    screen: PerArm[ScreenView]
    runlevel: Scalar  # int32
    pace: OwnPace | None
    grasp: OwnGrasp | None
    lifted: Scalar | None  # bool, the file had the foot off the pedal in the newest packet


def init(start: Start) -> OwnOperatorState:
    """Return the state of hands on the plan, in front of a robot at rest.

    Raises UserError for mistakes in the file.
    """
    setup, params, tips = start.setup, start.params.operator, start.tips
    assert setup.hands is not None
    poses = map(kinematics.forward_pose, setup.arms, start.jpos)
    models = tuple(pose.position for pose in poses)
    none, still = cast_to_real(setup, (0.0, Vec.full(3, 0.0)))
    zero = jnp.int32(0)
    state = OwnOperatorState(
        own=part.load_part(setup.hands).init(params.own.hands, setup.precision.real),
        screen=_screen(setup, tips, models, [(still, none)] * len(tips)),
        runlevel=jnp.int32(start.runlevel),
        pace=None,
        grasp=None,
        lifted=None,
    )
    plan = for_each_arm(setup, (still, none, still))
    _, keys = _stepped(setup, params, state, zero, jnp.bool_(False), plan)
    return replace(
        state,
        pace=OwnPace(none, zero, zero, zero) if "pace" in keys else None,
        grasp=OwnGrasp(*(for_each_arm(setup, none),) * 2) if "grasp" in keys else None,
        lifted=jnp.bool_(False) if "pedal" in keys else None,
    )


def act_as_file(state: OwnOperatorState, console: Console) -> OwnOperatorState:
    """Compute one millisecond of the file. A packet that was given stays as it is."""
    setup, signal, moment = console.setup, console.signal, console.plan
    if signal.packet is not None:
        return state
    hands, fresh, pace = console.hands, console.fresh, state.pace
    now, before = (
        operator.look_up_row(signal.motion, row)
        for row in (
            (moment.row, moment.before)
            if pace is None
            else (moment.row - pace.lag, moment.before - pace.before)
        )
    )

    def planned(offset: Vec, *rows: Any) -> tuple[Vec, Scalar, Vec]:
        position, old_position, grasp, old_grasp = cast_to_real(setup, rows)
        moves = position - old_position, grasp - old_grasp
        still = cast_to_real(setup, (Vec.full(3, 0.0), 0.0))
        return *where(moment.goes_on, moves, still), offset

    hands_in = now.position, before.position, now.grasp, before.grasp
    plan = tuple(map(planned, hands.offset, *hands_in))
    after, will = _stepped(
        setup, console.params.operator, state, signal.tick, now.surgeon_mode > 0, plan
    )
    state, how = replace(state, own=after), operator.PLAN
    if "delta" in will:
        console.hands = operator.with_stray_motion(
            hands,
            tuple(new - delta for new, (delta, _, _) in zip(will["delta"], plan, strict=True)),
        )
    if state.grasp is not None:
        old = state.grasp
        grasps = zip(old.offset, will["grasp"], plan, strict=True)
        grasp = tuple(x + (new - planned) for x, new, (_, planned, _) in grasps)
        how = how._replace(grasp=grasp, grasp_before=old.sent)
        state = replace(state, grasp=OwnGrasp(grasp, where(fresh, grasp, old.sent)))
    if state.lifted is not None:
        lifted = jnp.where(fresh, ~will["pedal"], state.lifted)
        how, state = how._replace(lifted=lifted), replace(state, lifted=lifted)
    if pace is not None:
        how = how._replace(lag=jnp.where(fresh, pace.lag, pace.sent), lag_before=pace.sent)
        share = will["pace"]
        share = jnp.where(share < 1.0, jnp.maximum(share, 0.0), 1.0)  # NaN means as planned
        behind = pace.part + jnp.where(moment.goes_on, 1.0 - share, 0.0)
        rows = as_int(behind)
        new_pace = OwnPace(
            part=behind - lax.convert_element_type(rows, behind.dtype),
            lag=pace.lag + rows,
            before=jnp.where(moment.goes_on, pace.lag, pace.before),
            sent=jnp.where(fresh, pace.lag, pace.sent),
        )
        state = replace(state, pace=new_pace)
    console.deviate = lambda timing: how
    return state


def show_state(state: OwnOperatorState, sight: Sight) -> OwnOperatorState:
    """Return the state with what the operator is shown until the next tick."""
    setup, signals = sight.setup, sight.signals

    def pulled(arm: ArmName, cue: haptics.HapticOutput) -> tuple[Vec, Scalar]:
        force = cue.force[0]
        pull = position_to_itp(arm, cue.direction * force)
        return pull.map(lambda x: jnp.where(x == x, x, 0.0)), force

    pulls = list(map(pulled, setup.arms, signals.haptics))
    screen = _screen(setup, signals.tip, sight.model_tips, pulls)
    return replace(state, screen=screen, runlevel=signals.control.runlevel)


def _screen(
    setup: RavenSetup, tips: PerArm[Vec], model_tips: PerArm[Vec], pulls: Sequence[Any]
) -> PerArm[ScreenView]:
    rows = zip(setup.arms, tips, model_tips, pulls, strict=True)
    shown = (
        ScreenView(position_to_itp(arm, tip), position_to_itp(arm, model), *pull)
        for arm, tip, model, pull in rows
    )
    return cast_to_real(setup, tuple(shown))


def _stepped(
    setup: RavenSetup,
    params: operator.OperatorParams,
    state: OwnOperatorState,
    tick: Scalar,
    pedal: Scalar,
    plan: PerArm[tuple[Vec, Scalar, Vec]],
) -> tuple[Any, ...]:
    """Return the file's new state and its other values. plan: um, mrad and um of each hand."""
    assert setup.hands is not None
    arms = tuple(
        View("the hands", {"delta": delta, "grasp": grasp, "offset": offset, **vars(shown)})
        for (delta, grasp, offset), shown in zip(plan, state.screen, strict=True)
    )
    scale = cast_to_real(setup, params.scale)
    seen = {"tick": tick, "runlevel": state.runlevel, "pedal": pedal, "scale": scale, "arms": arms}
    each = f"a tuple of {len(arms)}, one for each arm"
    like = {
        "delta": InPlace(tuple(arm.delta for arm in arms), f"{each}: a Vec of 3 numbers, um"),
        "grasp": InPlace(tuple(arm.grasp for arm in arms), f"{each}: a number, mrad"),
        "pedal": InPlace(pedal, "one truth value"),
        "pace": InPlace(cast_to_real(setup, 1.0), "one number, 0 to 1"),
    }
    return part.load_part(setup.hands).step(
        params.own.hands, state.own, View("the operator", seen), setup.precision.real, hands=like
    )
