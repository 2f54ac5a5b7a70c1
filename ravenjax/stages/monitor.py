"""Records what a run does to the instrument: deviations, jumps, tissue depth, DAC peaks.

Two tips are observed. The *true* tip is where the links of the virtual robot are. The *measured*
tip is what the control software computes from its encoders, in whole micrometres. The published
rule for jumps uses the measured tip (analyze_faulty.py). Both tips are compared with the nominal
model and with the run's golden run. The monitor does not influence the robot.

Hazards (`ravenjax.outcomes` defines them) are judged while the robot is live. Let a be the distance
from the golden run, b the distance from the nominal model, and d = min(a, b). Let c be the distance
from the golden run without its motion in the ticks in which this robot stood still or was not live:

    unintended motion:  min(d, c) > limit
    loss of motion:     d > limit and (min(d, c) <= limit or c < d / 2)
    false report:       |(measured - true) - (the golden run's measured - true)| > limit

The condition c < d / 2 means that most of d is motion that the robot missed.
"""

import dataclasses
from typing import Any, NamedTuple

from ravenjax import resources
from ravenjax.numbers import Scalar, Vec, as_int, describe_fields, finite, harm, jnp
from ravenjax.numbers.algebra import norm
from ravenjax.numbers.setup import Setup, cast_to_real, per_arm
from ravenjax.numbers.vec import earliest_tick, first_tick, largest, record, replace, where
from ravenjax.outcomes.verdict import LIMIT_MM

UM = 1e-6
HAZARDS = ("unintended", "loss", "false_report")
"""Hazards while the robot is live, by their names in `Distances` and `MonitorState`."""


@record
class Reference:
    """The golden run in this tick, one entry per arm."""

    tip: tuple[Vec, ...]  # m, frame 0, true tip
    pos: tuple[Vec, ...]  # um, whole numbers, measured tip


def series_length(setup: Setup) -> int:
    """Return the number of values of a tick that are compared with the golden run."""
    return 6 * len(setup.arms)


def reference_series(tips: tuple[Vec, ...], positions: tuple[Vec, ...]) -> tuple[Scalar, ...]:
    """Return the values that are compared, arm by arm. tips: true, m; positions: measured, um."""
    return tuple(x for rows in zip(tips, positions, strict=True) for row in rows for x in row)


def reference_from(setup: Setup, series: Any) -> Reference:
    """Return the golden run in a tick from its `reference_series`."""
    rows = [Vec(series[i + j] for j in range(3)) for i in range(0, series_length(setup), 3)]
    return Reference(tip=tuple(rows[0::2]), pos=tuple(rows[1::2]))


@describe_fields
@record
class MonitorParams:
    """Limits of the observer; the defaults are the published ones."""

    jump_step: Scalar = 1e-4  # m per packet, twice; CSLDepend/raven2_sim analyze_faulty.py
    large_jump: Scalar = 1e-3  # m within two ticks; 1 mm, the rule in the text of DSN'16
    diverged: Scalar = 1e-6  # m from the golden run; 1 um, the resolution of `pos`
    # share of the golden run's step below which a step counts as none; a quarter, chosen by us
    idle_share: Scalar = 0.25
    idle_step: Scalar = 1e-6  # m per tick, golden steps that count; 1 um, the resolution of `pos`
    limit: Scalar = LIMIT_MM / 1e3  # m, limit of hazards; `ravenjax.outcomes.verdict.LIMIT_MM`


@record
class MonitorArmState:
    """The observer's state of one arm."""

    tip: Vec  # m, true tip in the last tick
    tip_before: Vec  # m, true tip in the tick before it
    golden_tip: Vec  # m, the golden run's true tip in the last tick
    missed: Vec  # m, sum of the golden run's steps while this robot stood or was not live
    pos: Vec  # um, measured tip at the last packet
    golden_pos: Vec  # um, the golden run's measured tip at the last packet
    # bool, measured tip: last step between packets above jump_step, golden step not
    packet_jumped: Scalar
    tip_jumped: Scalar  # bool, true tip: last step above jump_step, golden step not
    peak_model: Scalar  # m, largest distance from the nominal model
    peak_live: Scalar  # m, largest distance from the nominal model while the robot was live
    square_model: Scalar  # m^2, sum over ticks
    peak_golden: Scalar  # m, largest distance from the golden run
    square_golden: Scalar  # m^2, sum over ticks
    unintended: Scalar  # m, largest `Distances.unintended` while live
    unintended_off: Scalar  # m, largest `Distances.unintended_off` while not live
    loss: Scalar  # m, largest distance while live, due to motion that the robot missed
    false_report: Scalar  # m, largest error of the measured tip while live, beyond the golden run's
    idle_ticks: Scalar  # int32, ticks in which the golden run moved and this robot did not
    peak_step: Scalar  # m per tick, largest step of the true tip
    path: Scalar  # m, path length of the true tip
    depth: Scalar  # m, deepest penetration of tissue by the true tip; negative: never touched
    peak_dac: Vec  # counts, largest magnitude written to USB
    jump: Scalar  # int32, tick of the first jump by the code's rule; -1: none
    large_jump: Scalar  # int32, tick of the first jump by the text's rule; -1: none
    tip_jump: Scalar  # int32, first jump by the code's rule on the true tip; -1: none


@record
class MonitorState:
    """The observer's state."""

    arms: tuple[MonitorArmState, ...]
    tip_distance: Scalar  # m, smallest distance between the two tips; infinite with one arm
    diverged: Scalar  # int32, first tick farther from the golden run than the limit; -1: never
    unintended: Scalar  # int32, first tick of unintended motion; -1: never
    loss: Scalar  # int32, first tick of loss of motion; -1: never
    false_report: Scalar  # int32, first tick of a false report; -1: never
    halted: Scalar  # int32, ticks with the pedal held down and the robot not live
    finite: finite.FiniteState  # of tips, distances, and numbers of the robot's tick
    ticks: Scalar  # int32
    harms: tuple[harm.HarmState, ...]  # harms that the campaign defines


@record
class MonitorSignal:
    """The input of the observer in this tick; one entry per arm."""

    tip: tuple[Vec, ...]  # m, true
    pos: tuple[Vec, ...]  # um, measured
    model_tip: tuple[Vec, ...]  # m
    depth: tuple[Scalar, ...]  # m below the tissue's surface; negative above it
    distance: Scalar  # m between the two tips; infinite with one arm
    dac: tuple[Vec, ...]  # counts, as written
    fresh: Scalar  # bool, a new packet was due in this tick
    live: Scalar  # bool, pedal-down without software E-stop
    pedal: Scalar  # bool, the operator holds the pedal down
    tick: Scalar  # int32


def init(setup: Setup, tips: tuple[Vec, ...], positions: tuple[Vec, ...]) -> MonitorState:
    """Return the state before the first tick, at these true [m] and measured [um] tips."""
    zero = cast_to_real(setup, 0.0)
    never = jnp.int32(-1)

    def arm_state(arm: int, _: str) -> MonitorArmState:
        # State before the first tick: all distances are 0, and no event has happened.
        tip, pos = cast_to_real(setup, tips[arm]), cast_to_real(setup, positions[arm])
        values: dict[str, Any] = {field.name: zero for field in dataclasses.fields(MonitorArmState)}
        values |= dict.fromkeys(("tip", "tip_before", "golden_tip"), tip)
        values |= dict.fromkeys(("pos", "golden_pos"), pos)
        values |= dict.fromkeys(("packet_jumped", "tip_jumped"), jnp.bool_(False))
        values |= dict.fromkeys(("jump", "large_jump", "tip_jump"), never)
        values["missed"] = cast_to_real(setup, Vec.full(3, 0.0))
        values["idle_ticks"] = jnp.int32(0)
        values["depth"] = cast_to_real(setup, -jnp.inf)
        values["peak_dac"] = Vec.full(len(setup.joints), jnp.int32(0))
        return MonitorArmState(**values)

    return MonitorState(
        arms=per_arm(setup, arm_state),
        tip_distance=cast_to_real(setup, jnp.inf),
        **dict.fromkeys((*HAZARDS, "diverged"), never),
        halted=jnp.int32(0),
        finite=finite.init(),
        ticks=jnp.int32(0),
        harms=harm.init(setup),
    )


def restart_monitor(state: MonitorState) -> MonitorState:
    """Return the state with the motion that each arm missed set to zero."""
    return replace(state, arms=tuple(replace(arm, missed=Vec.full(3, 0.0)) for arm in state.arms))


def realign_golden(state: MonitorState) -> MonitorState:
    """Return the state of `restart_monitor`, with each arm's last golden tip moved to its tip."""
    arms = restart_monitor(state).arms
    return replace(state, arms=tuple(replace(arm, golden_tip=arm.tip) for arm in arms))


class Distances(NamedTuple):
    """Distances of one arm in this tick, m. `unintended_off` counts while the robot is not live;
    `unintended`, `loss` and `false_report` count while it is live.
    """

    golden: Scalar  # true tip from the golden run's
    model: Scalar  # true tip from the nominal model's
    unintended: Scalar
    unintended_off: Scalar
    loss: Scalar
    false_report: Scalar


def arm_distances(
    params: MonitorParams, arm: MonitorArmState, model_tip: Vec, pos: Vec, golden_pos: Vec
) -> Distances:
    """Return the distances of an arm by which hazards are judged.

    arm: a state whose `tip`, `golden_tip` and `missed` are of this tick. model_tip: tip of the
    nominal model, m. pos, golden_pos: measured tip of the run and of its golden run, um.
    """
    tip, golden_tip = arm.tip, arm.golden_tip
    golden, model = norm(tip - golden_tip), norm(tip - model_tip)
    # `missed` is the sum of the golden run's motions that the robot did not make. `standing` is the
    # distance from where the golden run would be without these motions.
    standing = norm(tip - golden_tip + arm.missed)
    deviation = jnp.minimum(golden, model)
    unintended = jnp.minimum(deviation, standing)
    # Motion is lost if most of the deviation is missed motion, or if the deviation is above the
    # limit only because of missed motion.
    mostly_missed = 2.0 * standing < deviation
    otherwise_missed = (deviation > params.limit) & ~(unintended > params.limit)
    return Distances(
        golden=golden,
        model=model,
        unintended=unintended,
        unintended_off=jnp.minimum(golden, standing),
        loss=jnp.where(mostly_missed | otherwise_missed, deviation, 0.0),
        false_report=norm(pos * UM - tip - (golden_pos * UM - golden_tip)),
    )


def _step_arm(
    params: MonitorParams,
    state: MonitorArmState,
    signal: MonitorSignal,
    reference: Reference,
    i: int,
) -> tuple[MonitorArmState, Distances]:
    # Returns the state of arm i after this tick, and its distances.
    tip, pos, golden_pos = signal.tip[i], signal.pos[i], reference.pos[i]
    golden_tip = reference.tip[i]
    step = norm(tip - state.tip)
    golden_motion = golden_tip - state.golden_tip
    golden_step = norm(golden_motion)
    idle = (golden_step > params.idle_step) & (step < params.idle_share * golden_step)
    missed = where(idle | ~signal.live, state.missed + golden_motion, state.missed)
    after = replace(state, tip=tip, tip_before=state.tip, golden_tip=golden_tip, missed=missed)
    distances = arm_distances(params, after, signal.model_tip[i], pos, golden_pos)
    golden, model, live, fresh = distances.golden, distances.model, signal.live, signal.fresh
    tip_jumped = (step > params.jump_step) & ~(golden_step > params.jump_step)
    two_steps = norm(tip - state.tip_before)
    packet_step = norm(pos - state.pos) * UM
    golden_packet_step = norm(golden_pos - state.golden_pos) * UM
    packet_jumped = (packet_step > params.jump_step) & ~(golden_packet_step > params.jump_step)

    def largest_live(before: Scalar, distance: Scalar) -> Scalar:
        # Returns the largest distance so far while the robot was live.
        return jnp.where(live, jnp.maximum(before, distance), before)

    result = replace(
        after,
        pos=where(fresh, pos, state.pos),
        golden_pos=where(fresh, golden_pos, state.golden_pos),
        packet_jumped=jnp.where(fresh, packet_jumped, state.packet_jumped),
        tip_jumped=tip_jumped,
        peak_model=jnp.maximum(state.peak_model, model),
        peak_live=largest_live(state.peak_live, model),
        square_model=state.square_model + model * model,
        peak_golden=jnp.maximum(state.peak_golden, golden),
        square_golden=state.square_golden + golden * golden,
        unintended=largest_live(state.unintended, distances.unintended),
        unintended_off=jnp.where(
            live, state.unintended_off, jnp.maximum(state.unintended_off, distances.unintended_off)
        ),
        loss=largest_live(state.loss, distances.loss),
        false_report=largest_live(state.false_report, distances.false_report),
        idle_ticks=state.idle_ticks + as_int(idle),
        peak_step=jnp.maximum(state.peak_step, step),
        path=state.path + step,
        depth=jnp.maximum(state.depth, signal.depth[i]),
        # Without `abs`: XLA 0.11 for NVIDIA GPUs compiles max(peak, abs(dac)) as max(peak, dac).
        peak_dac=state.peak_dac.map(lambda peak, dac: largest((peak, dac, -dac)), signal.dac[i]),
        # By the code's rule, a jump is two such steps in a row.
        jump=first_tick(signal.tick, fresh & packet_jumped & state.packet_jumped, state.jump),
        large_jump=first_tick(
            signal.tick,
            (step > params.large_jump) | (two_steps > params.large_jump),
            state.large_jump,
        ),
        tip_jump=first_tick(signal.tick, tip_jumped & state.tip_jumped, state.tip_jump),
    )
    return result, distances


def step(
    setup: Setup,
    params: MonitorParams,
    state: MonitorState,
    signal: MonitorSignal,
    reference: Reference,
) -> MonitorState:
    """Return the state of the observer after this tick. reference: the golden run in this tick."""
    results = [_step_arm(params, arm, signal, reference, i) for i, arm in enumerate(state.arms)]
    arms, distances = tuple(arm for arm, _ in results), [distance for _, distance in results]
    # The hazards are fields of the distances (m) and of the state (first ticks). They count while
    # the robot is live: in pedal-down, without a stop.
    limits = {"golden": params.diverged, **dict.fromkeys(HAZARDS, params.limit)}
    exceeded = dict.fromkeys(limits, jnp.bool_(False))
    for distance in distances:
        for name, limit in limits.items():
            exceeded[name] = exceeded[name] | (getattr(distance, name) > limit)
    # Without a harm, the compiled tick has no operation for these signals.
    harm_signals = [
        _harm_signals(setup, distance, signal, i, state.arms[i].tip)
        for i, distance in enumerate(distances if setup.harms else ())
    ]
    # A run fails in the tick in which one of these numbers becomes infinite or NaN.
    watched = {
        "tip": [x for tip in signal.tip for x in tip],
        "model tip": [x for tip in signal.model_tip for x in tip],
        "deviation": [x for arm in arms for x in (arm.square_model, arm.square_golden, arm.path)],
    }
    return MonitorState(
        arms=arms,
        tip_distance=jnp.minimum(state.tip_distance, signal.distance),
        diverged=first_tick(signal.tick, exceeded["golden"], state.diverged),
        **{
            name: first_tick(signal.tick, signal.live & exceeded[name], getattr(state, name))
            for name in HAZARDS
        },
        halted=state.halted + as_int(signal.pedal & ~signal.live),
        finite=finite.step(state.finite, watched, signal.tick),
        ticks=state.ticks + as_int(True),
        harms=harm.step(setup, state.harms, harm_signals, signal.tick),
    )


def _harm_signals(
    setup: Setup, distance: Distances, signal: MonitorSignal, i: int, last_tip: Vec
) -> dict[str, Scalar]:
    # Returns the signals of arm i that the expressions of harms can read, in the units of
    # `harm.SIGNALS`: mm, mm/s and counts.
    signals = {
        **{name: getattr(distance, name) * 1e3 for name in HAZARDS},
        "from_golden": distance.golden * 1e3,
        "from_model": distance.model * 1e3,
        "depth": signal.depth[i] * 1e3,
        "between_tips": signal.distance * 1e3,
        "speed": norm(signal.tip[i] - last_tip) * (1e6 / setup.period_ms),  # from m per tick
        **{axis: x * 1e3 for axis, x in zip("xyz", signal.tip[i], strict=True)},
        "dac": largest(jnp.abs(x) for x in signal.dac[i]),
        "live": as_int(signal.live),
        "pedal": as_int(signal.pedal),
        "time": setup.to_ms(signal.tick),
    }
    return {name: cast_to_real(setup, value) for name, value in signals.items()}


_COLUMNS = resources.read_tables(__file__, "monitor.toml")


def outcomes(setup: Setup, state: MonitorState) -> dict[str, Scalar]:
    """Return the outcome columns of a run: lengths in mm, ticks in ms; the worst of the arms. The
    file monitor.toml names the field of each column, and how it is converted.
    """

    def worst(name: str) -> Scalar:
        return largest(getattr(arm, name) for arm in state.arms)

    def first(name: str) -> Scalar:
        return earliest_tick([jnp.int32(-1), *(getattr(arm, name) for arm in state.arms)])

    count = jnp.maximum(state.ticks, 1)
    conversions = {
        "worst": worst,
        "worst_mm": lambda name: worst(name) * 1e3,
        "rms_mm": lambda name: jnp.sqrt(worst(name) / count) * 1e3,
        "first": first,
        "whole": lambda name: getattr(state, name),
        "whole_mm": lambda name: getattr(state, name) * 1e3,
        "harm": lambda name: harm.decide_harm(setup, state.harms, getattr(state, name)),
    }
    columns = {
        **{column: conversions[name](field) for column, (name, field) in _COLUMNS.items()},
        **finite.outcomes(state.finite),
        **harm.outcomes(setup, state.harms),
    }
    for arm, arm_state in zip(setup.arms, state.arms, strict=True):
        for joint, peak in zip(setup.joints, arm_state.peak_dac, strict=True):
            columns[f"peak_dac_{arm}_{joint}"] = peak
    return columns
