"""Runs a user's file as the operator: what the file can read, and how the values that it returns
change the planned motion.

The plan is the motion that a campaign names. docs/how-to/own-operator.md lists what the file gets
in each millisecond, and the keys delta, grasp, pedal and pace that it may return. If a hand moves
differently than planned, the difference remains (`operator.HandOffsets`) until the file reverses
it. The robot and the nominal model both follow the hand. A file cannot change the hand's rotation.
It must return the same keys in every millisecond. A key that it never returns, or returns
unchanged, adds no computation.
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

    fraction: Scalar  # fraction of a row, in addition to `lag`
    lag: Scalar  # int32, the lag now
    lag_before: Scalar  # int32, the lag when the plan last continued
    lag_sent: Scalar  # int32, the lag in the newest packet


@record
class OwnGrasp:
    """The closing of the hands in addition to the plan, mrad."""

    offset: PerArm[Scalar]
    offset_sent: PerArm[Scalar]  # the offset in the newest packet


@record
class OwnOperatorState:
    """State of a user's operator; None for a key that the file does not return."""

    file_state: Any  # the state that the file's `init` or `step` returned
    screen: PerArm[ScreenView]
    runlevel: Scalar  # int32
    pace: OwnPace | None
    grasp: OwnGrasp | None
    lifted: Scalar | None  # bool, in the newest packet the file lifted the foot off the pedal


def init(start: Start) -> OwnOperatorState:
    """Return the state at the start of a run, when hands are on the plan. Raises UserError."""
    setup, params, tips = start.setup, start.params.operator, start.tips
    assert setup.hands is not None
    poses = map(kinematics.forward_pose, setup.arms, start.jpos)
    model_tips = tuple(pose.position for pose in poses)
    zero, zeros = cast_to_real(setup, (0.0, Vec.full(3, 0.0)))
    whole_zero, pedal = jnp.int32(0), jnp.bool_(False)
    no_cue = zeros, zero
    state = OwnOperatorState(
        file_state=part.load_part(setup.hands).init(params.own.hands, setup.precision.real),
        screen=_screen_views(setup, tips, model_tips, [no_cue] * len(tips)),
        runlevel=jnp.int32(start.runlevel),
        pace=None,
        grasp=None,
        lifted=None,
    )
    # Motion (um), closing (mrad) and offset from the plan (um) of each hand
    plan = for_each_arm(setup, (zeros, zero, zeros))
    # The file is called once, because its results show which keys it returns.
    _, returned = _run_file(setup, params, state, whole_zero, pedal, plan)
    offsets = for_each_arm(setup, zero)
    return replace(
        state,
        pace=OwnPace(zero, whole_zero, whole_zero, whole_zero) if "pace" in returned else None,
        grasp=OwnGrasp(offsets, offsets) if "grasp" in returned else None,
        lifted=jnp.bool_(False) if "pedal" in returned else None,
    )


def act_as_file(state: OwnOperatorState, console: Console) -> OwnOperatorState:
    """Run the file for one millisecond, and write to `console` how the hands leave the plan.
    If an external console sends the packets, the file does not run.
    """
    setup, signal, moment = console.setup, console.signal, console.plan
    if signal.packet is not None:
        return state
    hands, fresh, pace = console.hands, console.fresh, state.pace
    rows = moment.row, moment.before
    if pace is not None:
        rows = moment.row - pace.lag, moment.before - pace.lag_before
    row, row_before = (operator.look_up_row(signal.motion, number) for number in rows)

    def planned_motion(offset: Vec, *values) -> tuple[Vec, Scalar, Vec]:
        # Returns motion, closing and present offset of one hand, the entries of `plan`.
        position, old_position, grasp, old_grasp = cast_to_real(setup, values)
        motion = position - old_position, grasp - old_grasp
        no_motion = cast_to_real(setup, (Vec.full(3, 0.0), 0.0))
        return *where(moment.continues, motion, no_motion), offset

    hand_columns = row.position, row_before.position, row.grasp, row_before.grasp
    plan = tuple(map(planned_motion, hands.offset, *hand_columns))
    file_state, returned = _run_file(
        setup, console.params.operator, state, signal.tick, row.surgeon_mode > 0, plan
    )
    state, deviation = replace(state, file_state=file_state), operator.NO_DEVIATION
    if "delta" in returned:
        per_hand = zip(returned["delta"], plan, strict=True)
        stray_motion = tuple(delta - planned for delta, (planned, _, _) in per_hand)
        console.hands = operator.add_hand_motion(hands, stray_motion)
    if state.grasp is not None:
        old = state.grasp
        per_hand = zip(old.offset, returned["grasp"], plan, strict=True)
        offsets = tuple(offset + (grasp - planned) for offset, grasp, (_, planned, _) in per_hand)
        deviation = deviation._replace(grasp=offsets, grasp_before=old.offset_sent)
        state = replace(state, grasp=OwnGrasp(offsets, where(fresh, offsets, old.offset_sent)))
    if state.lifted is not None:
        lifted = jnp.where(fresh, ~returned["pedal"], state.lifted)
        deviation, state = deviation._replace(lifted=lifted), replace(state, lifted=lifted)
    if pace is not None:
        lag_sent = jnp.where(fresh, pace.lag, pace.lag_sent)
        deviation = deviation._replace(lag=lag_sent, lag_before=pace.lag_sent)
        new_pace = _advance_pace(pace, returned["pace"], moment.continues, lag_sent)
        state = replace(state, pace=new_pace)
    console.deviate = lambda timing: deviation
    return state


def _advance_pace(pace: OwnPace, share: Scalar, continues: Scalar, lag_sent: Scalar) -> OwnPace:
    """Return the lag behind the plan after one millisecond. share: rows of the plan that the hands
    perform in it, 0 to 1. continues: bool, the plan continues. lag_sent: lag in the newest packet.
    """
    # A comparison with NaN is false, so NaN gives the planned pace.
    share = jnp.where(share < 1.0, jnp.maximum(share, 0.0), 1.0)
    behind = pace.fraction + jnp.where(continues, 1.0 - share, 0.0)
    # `lag` counts whole rows, and `fraction` keeps the rest.
    whole_rows = as_int(behind)
    return OwnPace(
        fraction=behind - lax.convert_element_type(whole_rows, behind.dtype),
        lag=pace.lag + whole_rows,
        lag_before=jnp.where(continues, pace.lag, pace.lag_before),
        lag_sent=lag_sent,
    )


def show_state(state: OwnOperatorState, sight: Sight) -> OwnOperatorState:
    """Return the state with what the operator sees and feels until the next tick."""
    setup, signals = sight.setup, sight.signals

    def first_cue(arm: ArmName, cue: haptics.HapticOutput) -> tuple[Vec, Scalar]:
        # Returns vector and magnitude of the force of the first haptic set.
        force = cue.force[0]
        pull = position_to_itp(arm, cue.direction * force)
        # A component that is NaN becomes 0: the device does not pull.
        return pull.map(lambda x: jnp.where(x == x, x, 0.0)), force

    cues = list(map(first_cue, setup.arms, signals.haptics))
    screen = _screen_views(setup, signals.tip, sight.model_tips, cues)
    return replace(state, screen=screen, runlevel=signals.control.runlevel)


def _screen_views(
    setup: RavenSetup, tips: PerArm[Vec], model_tips: PerArm[Vec], cues: Sequence[Any]
) -> PerArm[ScreenView]:
    # Returns tips and cue of each arm in the axes of the console.
    # cues: force vector (console's axes) and its magnitude for each arm, device units.
    views = (
        ScreenView(position_to_itp(arm, tip), position_to_itp(arm, model_tip), *cue)
        for arm, tip, model_tip, cue in zip(setup.arms, tips, model_tips, cues, strict=True)
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
    """Return the file's new state, and a dict with the values that the file returned.
    pedal: bool, the plan holds the pedal down. plan: for each hand the motion (um) and closing
    (mrad) that are planned for this tick, and the present offset from the plan (um).
    """
    assert setup.hands is not None
    arms = tuple(
        View("the hands", {"delta": delta, "grasp": grasp, "offset": offset, **vars(screen)})
        for (delta, grasp, offset), screen in zip(plan, state.screen, strict=True)
    )
    scale = cast_to_real(setup, params.scale)
    view = {"tick": tick, "runlevel": state.runlevel, "pedal": pedal, "scale": scale, "arms": arms}
    per_arm = f"a tuple of {len(arms)}, one for each arm"
    # Form of each value that the file may return. Values that it returns unchanged are left out.
    examples = {
        "delta": InPlace(tuple(arm.delta for arm in arms), f"{per_arm}: a Vec of 3 numbers, um"),
        "grasp": InPlace(tuple(arm.grasp for arm in arms), f"{per_arm}: a number, mrad"),
        "pedal": InPlace(pedal, "one truth value"),
        "pace": InPlace(cast_to_real(setup, 1.0), "one number, 0 to 1"),
    }
    file, file_view = part.load_part(setup.hands), View("the operator", view)
    real = setup.precision.real
    return file.step(params.own.hands, state.file_state, file_view, real, hands=examples)
