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
    """What the operator sees and feels of an arm, in the console's axes; origin: frame 0."""

    tip: Vec  # 3 m, true tip, as the camera shows it
    model_tip: Vec  # 3 m, tip of the nominal model
    pull: Vec  # 3 device units, force of the first haptic set
    force: Scalar  # device units, magnitude of that force; above 0 the cue is shown


@record
class OwnPace:
    """The lag of the hands behind the plan, in rows of the plan."""

    part: Scalar  # fraction of a row, in addition to `lag`
    lag: Scalar  # int32, the lag now
    before: Scalar  # int32, the lag when the plan last continued
    sent: Scalar  # int32, the lag in the newest packet


@record
class OwnGrasp:
    """The closing of the hands in addition to the plan, mrad."""

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
    lifted: Scalar | None  # bool, in the newest packet the file lifted the foot off the pedal


def init(start: Start) -> OwnOperatorState:
    """Return the state of hands on the plan, in front of a robot at rest.

    Raises UserError for mistakes in the file.
    """
    setup, params, tips = start.setup, start.params.operator, start.tips
    assert setup.hands is not None
    poses = map(kinematics.forward_pose, setup.arms, start.jpos)
    model_tips = tuple(pose.position for pose in poses)
    nothing, no_motion = cast_to_real(setup, (0.0, Vec.full(3, 0.0)))
    zero = jnp.int32(0)
    state = OwnOperatorState(
        own=part.load_part(setup.hands).init(params.own.hands, setup.precision.real),
        screen=_screen(setup, tips, model_tips, [(no_motion, nothing)] * len(tips)),
        runlevel=jnp.int32(start.runlevel),
        pace=None,
        grasp=None,
        lifted=None,
    )
    plan = for_each_arm(setup, (no_motion, nothing, no_motion))
    _, keys = _run_file(setup, params, state, zero, jnp.bool_(False), plan)
    return replace(
        state,
        pace=OwnPace(nothing, zero, zero, zero) if "pace" in keys else None,
        grasp=OwnGrasp(*(for_each_arm(setup, nothing),) * 2) if "grasp" in keys else None,
        lifted=jnp.bool_(False) if "pedal" in keys else None,
    )


def act_as_file(state: OwnOperatorState, console: Console) -> OwnOperatorState:
    """Run the file for one millisecond, and set the deviations of the hands from the plan.

    If an external console sends the packets, the file does not run.
    """
    setup, signal, moment = console.setup, console.signal, console.plan
    if signal.packet is not None:
        return state
    hands, fresh, pace = console.hands, console.fresh, state.pace
    row, row_before = (
        operator.look_up_row(signal.motion, row)
        for row in (
            (moment.row, moment.before)
            if pace is None
            else (moment.row - pace.lag, moment.before - pace.before)
        )
    )

    def planned(offset: Vec, *values) -> tuple[Vec, Scalar, Vec]:
        position, old_position, grasp, old_grasp = cast_to_real(setup, values)
        moves = position - old_position, grasp - old_grasp
        still = cast_to_real(setup, (Vec.full(3, 0.0), 0.0))
        return *where(moment.goes_on, moves, still), offset

    hands_in = row.position, row_before.position, row.grasp, row_before.grasp
    plan = tuple(map(planned, hands.offset, *hands_in))
    file_state, returned = _run_file(
        setup, console.params.operator, state, signal.tick, row.surgeon_mode > 0, plan
    )
    state, deviation = replace(state, own=file_state), operator.NO_DEVIATION
    if "delta" in returned:
        console.hands = operator.add_hand_motion(
            hands,
            tuple(new - delta for new, (delta, _, _) in zip(returned["delta"], plan, strict=True)),
        )
    if state.grasp is not None:
        old = state.grasp
        grasps = zip(old.offset, returned["grasp"], plan, strict=True)
        grasp = tuple(x + (new - planned) for x, new, (_, planned, _) in grasps)
        deviation = deviation._replace(grasp=grasp, grasp_before=old.sent)
        state = replace(state, grasp=OwnGrasp(grasp, where(fresh, grasp, old.sent)))
    if state.lifted is not None:
        lifted = jnp.where(fresh, ~returned["pedal"], state.lifted)
        deviation, state = deviation._replace(lifted=lifted), replace(state, lifted=lifted)
    if pace is not None:
        deviation = deviation._replace(
            lag=jnp.where(fresh, pace.lag, pace.sent), lag_before=pace.sent
        )
        share = returned["pace"]
        share = jnp.where(share < 1.0, jnp.maximum(share, 0.0), 1.0)  # NaN: the planned pace
        behind = pace.part + jnp.where(moment.goes_on, 1.0 - share, 0.0)
        rows = as_int(behind)
        new_pace = OwnPace(
            part=behind - lax.convert_element_type(rows, behind.dtype),
            lag=pace.lag + rows,
            before=jnp.where(moment.goes_on, pace.lag, pace.before),
            sent=jnp.where(fresh, pace.lag, pace.sent),
        )
        state = replace(state, pace=new_pace)
    console.deviate = lambda timing: deviation
    return state


def show_state(state: OwnOperatorState, sight: Sight) -> OwnOperatorState:
    """Return the state with what the operator sees and feels until the next tick."""
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
    # Returns the tips and cues of each arm in the axes of the console.
    rows = zip(setup.arms, tips, model_tips, pulls, strict=True)
    views = (
        ScreenView(position_to_itp(arm, tip), position_to_itp(arm, model), *pull)
        for arm, tip, model, pull in rows
    )
    return cast_to_real(setup, tuple(views))


def _run_file(
    setup: RavenSetup,
    params: operator.OperatorParams,
    state: OwnOperatorState,
    tick: Scalar,
    pedal: Scalar,
    plan: PerArm[tuple[Vec, Scalar, Vec]],
) -> tuple[Any, ...]:
    """Return the file's new state, and the values that the file returned by key.

    plan: planned motion (um), closing (mrad) and present offset (um) of each hand.
    """
    assert setup.hands is not None
    arms = tuple(
        View("the hands", {"delta": delta, "grasp": grasp, "offset": offset, **vars(shown)})
        for (delta, grasp, offset), shown in zip(plan, state.screen, strict=True)
    )
    scale = cast_to_real(setup, params.scale)
    view = {"tick": tick, "runlevel": state.runlevel, "pedal": pedal, "scale": scale, "arms": arms}
    per_arm = f"a tuple of {len(arms)}, one for each arm"
    examples = {
        "delta": InPlace(tuple(arm.delta for arm in arms), f"{per_arm}: a Vec of 3 numbers, um"),
        "grasp": InPlace(tuple(arm.grasp for arm in arms), f"{per_arm}: a number, mrad"),
        "pedal": InPlace(pedal, "one truth value"),
        "pace": InPlace(cast_to_real(setup, 1.0), "one number, 0 to 1"),
    }
    return part.load_part(setup.hands).step(
        params.own.hands,
        state.own,
        View("the operator", view),
        setup.precision.real,
        hands=examples,
    )
