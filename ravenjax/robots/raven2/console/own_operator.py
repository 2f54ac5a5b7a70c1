"""A user's file as the operator: what it sees, and how its hands change the plan. Traced.

The plan is the motion that a campaign names, generated or recorded. In each millisecond the file
sees by how much the plan moves each hand, and what the screen and the haptic device showed a
millisecond before. It gives a dict; what it leaves out stays as planned:

    delta   how far each hand moves in this millisecond, in place of the plan's
    grasp   how much each hand closes in this millisecond, in place of the plan's
    pedal   whether the foot stays on the pedal; it may leave it, and be back, but never press where the plan does not
    pace    share of its speed at which the plan goes on from the next millisecond, hands and pedal alike: 0 waits

A hand that moves otherwise than planned is off its plan by the difference (`operator.HandOffsets`)
and stays so until the file takes it back. Robot and nominal model follow it alike. The hand's
rotation is the plan's. Which of the keys a file gives is the same in all milliseconds. What it does
not give, or gives back as it came, costs nothing.
"""  # noqa: E501

from __future__ import annotations

from typing import Any, NamedTuple

from ravenjax.numbers.lazy import jnp, lax
from ravenjax.numbers.setup import per_arm, real
from ravenjax.numbers.vec import Scalar, Vec, as_int, record, replace, where
from ravenjax.parts import part
from ravenjax.parts.part import InPlace, View
from ravenjax.robots.raven2.arms import ArmName
from ravenjax.robots.raven2.console import operator
from ravenjax.robots.raven2.geometry import kinematics
from ravenjax.robots.raven2.geometry.mapping import position_to_itp
from ravenjax.robots.raven2.setup import RavenSetup
from ravenjax.stages import haptics


@record
class ScreenView:
    """What the operator sees and feels of one arm; positions about the axes of the console, from
    the arm's base.
    """

    tip: Vec  # 3 m, true tip, as the camera shows it
    model_tip: Vec  # 3 m, that of the nominal model
    pull: Vec  # 3 device units, force of the first haptic set
    force: Scalar  # device units, its size; above 0 the cue is shown


@record
class OwnPace:
    """How far the hands are behind the plan, in its rows."""

    part: Scalar  # of a row, beyond `lag`
    lag: Scalar  # int32, now
    before: Scalar  # int32, when the plan last went on
    sent: Scalar  # int32, in the newest packet


@record
class OwnGrasp:
    """By how much the hands are closed beyond the plan, mrad, one entry an arm."""

    offset: tuple[Scalar, ...]
    sent: tuple[Scalar, ...]  # in the newest packet


@record
class OwnOperatorState:
    """What is remembered; None: the file does not give such a key."""

    own: Any  # what its `init` gave
    screen: tuple[ScreenView, ...]  # one an arm
    runlevel: Scalar  # int32
    pace: OwnPace | None
    grasp: OwnGrasp | None
    lifted: Scalar | None  # bool, the file had the foot off the pedal in the newest packet


class PlanMoment(NamedTuple):
    """Where the plan is in a tick."""

    row: Scalar  # int32, row of the motion
    before: Scalar  # int32, the same when the plan last went on
    goes_on: Scalar  # bool, in this tick


def init(
    setup: RavenSetup,
    params: operator.OperatorParams,
    start: tuple[Vec, ...],
    tips: tuple[Vec, ...],
    runlevel: int,
) -> OwnOperatorState:
    """On the plan, before a robot at rest.

    start: joints, 7, rad and m; tips: m in frame 0. Raises UserError, as all that runs the file.
    """
    assert setup.hands is not None
    models = per_arm(setup, lambda i, arm: kinematics.forward(arm, start[i]).position)
    none, still, zero = real(setup, 0.0), real(setup, Vec.full(3, 0.0)), jnp.int32(0)

    def shown(i: int, arm: ArmName) -> ScreenView:
        return ScreenView(
            position_to_itp(arm, tips[i]), position_to_itp(arm, models[i]), still, none
        )

    screen = real(setup, per_arm(setup, shown))
    own = part.loaded(setup.hands).init(params.own.hands, setup.precision.real)
    plan = tuple((still, none, still) for _ in screen)
    _, keys = _stepped(
        setup, params, own, zero, jnp.int32(runlevel), jnp.bool_(False), plan, screen
    )
    return OwnOperatorState(
        own=own,
        screen=screen,
        runlevel=jnp.int32(runlevel),
        pace=OwnPace(none, zero, zero, zero) if "pace" in keys else None,
        grasp=(
            OwnGrasp((none,) * len(setup.arms), (none,) * len(setup.arms))
            if "grasp" in keys
            else None
        ),
        lifted=jnp.bool_(False) if "pedal" in keys else None,
    )


def act(
    setup: RavenSetup,
    params: operator.OperatorParams,
    state: OwnOperatorState,
    hands: operator.HandOffsets,
    motion: tuple[Any, ...],
    moment: PlanMoment,
    fresh: Scalar,
    tick: Scalar,
) -> tuple[OwnOperatorState, operator.HandOffsets, operator.Deviation]:
    """One millisecond of the file. fresh: bool, whether a packet is made in it."""
    pace = state.pace
    now = operator.lookup(motion, moment.row if pace is None else moment.row - pace.lag)
    before = operator.lookup(motion, moment.before if pace is None else moment.before - pace.before)

    def planned(i: int, arm: ArmName) -> tuple[Vec, Scalar, Vec]:
        delta = real(setup, now.position[i]) - real(setup, before.position[i])
        grasp = real(setup, now.grasp[i]) - real(setup, before.grasp[i])
        delta, grasp = where(moment.goes_on, (delta, grasp), real(setup, (Vec.full(3, 0.0), 0.0)))
        return delta, grasp, hands.offset[i]

    plan = per_arm(setup, planned)
    own, will = _stepped(
        setup, params, state.own, tick, state.runlevel, now.surgeon_mode > 0, plan, state.screen
    )
    state, how = replace(state, own=own), operator.PLAN
    if "delta" in will:
        hands = operator.strayed(
            hands,
            tuple(new - delta for new, (delta, _, _) in zip(will["delta"], plan, strict=True)),
        )
    if state.grasp is not None:
        old = state.grasp
        changes = (new - grasp for new, (_, grasp, _) in zip(will["grasp"], plan, strict=True))
        grasp = tuple(x + change for x, change in zip(old.offset, changes, strict=True))
        how = how._replace(grasp=grasp, grasp_before=old.sent)
        state = replace(state, grasp=OwnGrasp(grasp, where(fresh, grasp, old.sent)))
    if state.lifted is not None:
        lifted = jnp.where(fresh, ~will["pedal"], state.lifted)
        how, state = how._replace(lifted=lifted), replace(state, lifted=lifted)
    if pace is not None:
        how = how._replace(lag=jnp.where(fresh, pace.lag, pace.sent), lag_before=pace.sent)
        state = replace(state, pace=_slowed(pace, will["pace"], moment.goes_on, fresh))
    return state, hands, how


def see(
    setup: RavenSetup,
    state: OwnOperatorState,
    tips: tuple[Vec, ...],
    model_tips: tuple[Vec, ...],
    cues: tuple[haptics.HapticOutput, ...],
    runlevel: Scalar,
) -> OwnOperatorState:
    """After a tick: what screen and haptic device show until the next one. tips: m in frame 0,
    one an arm.
    """

    def shown(i: int, arm: ArmName) -> ScreenView:
        force = cues[i].force[0]
        pull = position_to_itp(arm, cues[i].direction * force).map(
            lambda x: jnp.where(x == x, x, 0.0)
        )
        return ScreenView(
            position_to_itp(arm, tips[i]), position_to_itp(arm, model_tips[i]), pull, force
        )

    return replace(state, screen=real(setup, per_arm(setup, shown)), runlevel=runlevel)


def _stepped(
    setup: RavenSetup,
    params: operator.OperatorParams,
    own: Any,
    tick: Scalar,
    runlevel: Scalar,
    pedal: Scalar,
    plan: tuple[tuple[Vec, Scalar, Vec], ...],
    screen: tuple[ScreenView, ...],
) -> tuple[Any, ...]:
    """What the file remembers, and what it gives. plan: of each hand how far it moves (um) and
    closes (mrad) in this millisecond, and how far it is off already (um).
    """
    assert setup.hands is not None
    arms = tuple(
        View("the hands", {"delta": delta, "grasp": grasp, "offset": offset, **vars(shown)})
        for (delta, grasp, offset), shown in zip(plan, screen, strict=True)
    )
    view = View(
        "the operator",
        {
            "tick": tick,
            "runlevel": runlevel,
            "pedal": pedal,
            "scale": real(setup, params.scale),
            "arms": arms,
        },
    )
    each = f"a tuple of {len(arms)}, one for each arm"
    like = {
        "delta": InPlace(tuple(arm.delta for arm in arms), f"{each}: a Vec of 3 numbers, um"),
        "grasp": InPlace(tuple(arm.grasp for arm in arms), f"{each}: a number, mrad"),
        "pedal": InPlace(pedal, "one truth value"),
        "pace": InPlace(real(setup, 1.0), "one number, 0 to 1"),
    }
    return part.loaded(setup.hands).step(
        params.own.hands, own, view, setup.precision.real, hands=like
    )


def _slowed(pace: OwnPace, share: Scalar, goes_on: Scalar, fresh: Scalar) -> OwnPace:
    """After a millisecond from which on the plan goes on at `share` of its speed."""
    share = jnp.where(share < 1.0, jnp.maximum(share, 0.0), 1.0)  # what is no number is as planned
    behind = pace.part + jnp.where(goes_on, 1.0 - share, 0.0)
    rows = as_int(behind)
    return OwnPace(
        part=behind - lax.convert_element_type(rows, behind.dtype),
        lag=pace.lag + rows,
        before=jnp.where(goes_on, pace.lag, pace.before),
        sent=jnp.where(fresh, pace.lag, pace.sent),
    )
