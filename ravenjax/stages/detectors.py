"""Computes detectors, which score every millisecond of a run and raise an alarm above a threshold.

Built-in detectors do not act on the robot. A user's detector may also stop the robot: its alarm
triggers the E-stop a millisecond later. The score of a tick is the higher score of the two arms.
There are five kinds:

- `steps`: the model-based detector of DSN'16. A dynamic model that gets the written command
  predicts how motors and joints 1-3 move. The virtual robot is used as that model. A *step* is a
  change within 1 ms. Steps of motor position, motor velocity and joint position give one score
  each. For each of the three joints, the step is divided by its largest usual step
  (`LEARNED_STEPS`); the score is the largest quotient. As published, the score of motor velocity is
  the smaller of the quotients of this tick and the last. The three scores are *fused*: `all` (the
  published rule) uses the smallest of them, `two` the middle score, `any` the largest; `mpos`,
  `mvel` and `jpos` use only the score of this name.
- `derivative_sum`: |link velocities| + |link accelerations| + 0.001 (|motor velocities| + |motor
  accelerations|), summed over joints 1-3, in the authors' mixed units (sys_dyn_gold_euler_detect of
  raven2_sim, threshold 55).
- `tip_error`: distance in mm between nominal model and reported tip, the input of the haptic cue.
- `overdrive`: |current_cmd| divided by the limit at which the control software clips, the largest
  of its checked joints.
- `own`: the score of a user's file (`ravenjax.parts`).

An alarm needs a score above its threshold for `consecutive` milliseconds in a row. The *score of a
run* is the highest threshold at which the run raises an alarm. It is the maximum over time of the
smallest score in `consecutive` milliseconds. With this score, one campaign shows the effect of
every threshold. Detectors are active in pedal-down, without software E-stop, after `armed_after`.
"""

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np

from ravenjax import resources
from ravenjax.numbers import Setup, cast_to_real, describe_fields, for_each_arm, jnp, per_arm
from ravenjax.numbers.vec import Scalar, Vec, as_int, first_tick, record
from ravenjax.parts import part
from ravenjax.vocabulary import TICK_S
from ravenjax.vocabulary.detectors import DetectorUse
from ravenjax.vocabulary.parts import OwnSource

POSITIONING = 3
MOTOR_WEIGHT = 0.001
"""Weight of motor derivatives in `derivative_sum`; from raven2_sim."""
MAX_SCORE = 1e30
"""Largest score. Flipped bits can move a reported joint by 1e38 rad, so scores are limited."""

LEARNED_STEPS: dict[str, list[float]] = resources.read_tables(__file__, "detectors.toml")
"""Learned steps of motor position [rad] and velocity [rad/s], and joint position [rad; m].

They are the 99.85 percentile of fault-free steps of seven motions at scales 0.05 and 0.1, from
analysis/detector_thresholds/learn.py.
"""


@describe_fields
@record
class StepScale:
    """The unit in which detector `steps` measures a joint's motion within 1 ms."""

    mpos: Scalar
    mvel: Scalar
    jpos: Scalar


@describe_fields
@record
class WatchParams:
    """Parameters of users' detectors that a campaign may vary."""

    armed_after: Scalar  # int32, ms from the start of the run in which detectors are inactive
    own: tuple[Any, ...]  # for each detector, by name: the parameter record of its file, or None
    thresholds: tuple[tuple[Scalar, ...], ...]  # of each detector, in the unit of its score


@record
class DetectorParams(WatchParams):
    """Parameters of all detectors."""

    shoulder: StepScale
    elbow: StepScale
    insertion: StepScale


@record
class DetectorArmState:
    """One arm's values in the last tick."""

    mpos: Vec  # 3, rad
    mvel: Vec  # 3, rad/s
    jpos: Vec  # 3, rad and m
    jvel: Vec  # 3, rad/s and m/s
    mvel_step: Scalar  # 1, largest step of motor velocity, divided by its learned step


@record
class ThresholdState:
    """The alarms of one threshold of a detector so far."""

    first_tick: Scalar  # int32, tick of the first alarm; -1: none
    alarms: Scalar  # int32, separate alarms
    is_on: Scalar  # bool, the alarm is on


@record
class DetectorState:
    """The scores and alarms of one detector so far."""

    recent: Vec  # scores of the last `consecutive` - 1 ticks, latest first
    peak: Scalar  # score of the run so far
    thresholds: tuple[ThresholdState, ...]


@record
class DetectorsState:
    """State of all detectors."""

    arms: tuple[DetectorArmState, ...]
    own: tuple[tuple[Any, ...], ...]  # states of users' files: for each file, one entry per arm
    detectors: tuple[DetectorState, ...]


@record
class WatchSignal:
    """The input of users' detectors in this tick."""

    armed: Scalar  # bool, pedal-down without software E-stop
    tick: Scalar  # int32
    views: tuple[Any, ...]  # for each arm, as the robot defines it; (): no files


@record
class DetectorSignal(WatchSignal):
    """The input of all detectors in this tick; tuples have one entry per arm."""

    mpos: tuple[Vec, ...]  # 7, rad, motors of the dynamic model
    mvel: tuple[Vec, ...]  # 7, rad/s
    jpos: tuple[Vec, ...]  # 7, rad and m, links of the dynamic model
    jvel: tuple[Vec, ...]  # 7, rad/s and m/s
    tip_error: tuple[Scalar, ...]  # m
    command: tuple[Vec, ...]  # 7 int32 DAC counts, before the overdrive check
    command_limit: Vec  # 7 int32 DAC counts, limits at which the overdrive check clips


def detector_files(setup: Setup) -> tuple[OwnSource, ...]:
    """Return the files of users' detectors in order. A file of several detectors occurs once."""
    files = [detector.part for detector in setup.detectors if detector.part is not None]
    return tuple(dict.fromkeys(files))


def watch_params(setup: Setup) -> WatchParams:
    """Return the parameters of a robot without built-in detectors. Detectors are active after 500
    ms. The thresholds of 1 are placeholders, which a campaign replaces.
    """
    files = detector_files(setup)
    return WatchParams(
        armed_after=np.int32(500),
        own=part.part_parameters(files) if files else (),
        thresholds=tuple((1.0,) * detector.thresholds for detector in setup.detectors),
    )


def params(setup: Setup) -> DetectorParams:
    """Return the parameters of all detectors: `watch_params` and the learned steps."""
    steps: dict[str, Any] = {joint: StepScale(*values) for joint, values in LEARNED_STEPS.items()}
    return DetectorParams(**vars(watch_params(setup)) | steps)


def init(setup: Setup, params: WatchParams) -> DetectorsState:
    """Return the state before the first tick."""
    zero = cast_to_real(setup, 0.0)
    zeros = Vec.full(POSITIONING, zero)
    no_alarm = ThresholdState(first_tick=jnp.int32(-1), alarms=jnp.int32(0), is_on=jnp.bool_(False))
    detectors = tuple(
        DetectorState(Vec.full(use.consecutive - 1, zero), zero, (no_alarm,) * use.thresholds)
        for use in setup.detectors
    )
    file_states = tuple(
        for_each_arm(setup, part.load_part(source).init(values, setup.precision.real))
        for source, values in zip(detector_files(setup), params.own, strict=True)
    )
    arms = for_each_arm(setup, DetectorArmState(zeros, zeros, zeros, zeros, zero))
    return DetectorsState(arms, file_states, detectors)


def step(
    setup: Setup, params: WatchParams, state: DetectorsState, signal: WatchSignal
) -> DetectorsState:
    """Return the state of all detectors after this tick. A robot without built-in detectors gives
    a `WatchSignal`, another robot a `DetectorSignal`.
    """
    # For each arm: the state after this tick, and the scores of the built-in detectors. A robot
    # without them has the start state of its first arm and no scores.
    arm_results: Any = for_each_arm(setup, (state.arms[0], {}))
    if isinstance(signal, DetectorSignal):
        arm_results = per_arm(
            setup, lambda arm, _: _score_arm(setup, params, state.arms[arm], signal, arm)
        )
    # For each file and arm: the state after this tick, and the score.
    file_results = {}
    for source, values, arm_states in zip(
        detector_files(setup), params.own, state.own, strict=True
    ):
        loaded = part.load_part(source)
        file_results[source] = [
            loaded.step(values, arm_state, view, setup.precision.real, score=part.SCORE)
            for arm_state, view in zip(arm_states, signal.views, strict=True)
        ]
    is_active = signal.armed & (setup.to_ms(signal.tick) >= params.armed_after)
    detectors = []
    for detector, thresholds, before in zip(
        setup.detectors, params.thresholds, state.detectors, strict=True
    ):
        if detector.part is None:
            arm_scores = [_score(detector, scores) for _, scores in arm_results]
        else:
            arm_scores = [score for _, score in file_results[detector.part]]
        # MAX_SCORE keeps the score finite.
        highest = jnp.minimum(_largest(setup, arm_scores), MAX_SCORE)
        score = jnp.where(is_active, highest, 0.0)
        detectors.append(_update_alarms(before, thresholds, score, signal.tick))
    arm_states = tuple(state for state, _ in arm_results)
    file_states = tuple(tuple(state for state, _ in arms) for arms in file_results.values())
    return DetectorsState(arm_states, file_states, tuple(detectors))


def detector_stops(setup: Setup, state: DetectorsState | None) -> Scalar:
    """Return whether a detector that may stop the robot is above its first threshold, bool. state:
    None if the campaign has no detectors.
    """
    alarms = jnp.bool_(False)
    if state is None:
        return alarms
    for declared, detector in zip(setup.detectors, state.detectors, strict=True):
        if declared.stops:
            alarms = alarms | detector.thresholds[0].is_on
    return alarms


def outcomes(setup: Setup, state: DetectorsState) -> dict[str, Scalar]:
    """Return the outcome columns of all detectors of a run: the score of the run, and for each
    threshold the time of the first alarm (ms; -1: none) and the number of alarms.
    """
    columns = {}
    for d, detector in enumerate(state.detectors):
        columns[f"detector{d}_score"] = detector.peak
        for k, threshold in enumerate(detector.thresholds):
            columns[f"detector{d}_threshold{k}_first_ms"] = threshold.first_tick
            columns[f"detector{d}_threshold{k}_alarms"] = threshold.alarms
    return columns


def _largest(setup: Setup, scores: Sequence[Scalar]) -> Scalar:
    """Return the largest score above 0, else 0. NaN is ignored: a comparison with NaN is false."""
    return reduce(
        lambda most, score: jnp.where(score > most, score, most), scores, cast_to_real(setup, 0.0)
    )


def _score_arm(
    setup: Setup, params, before: DetectorArmState, signal: DetectorSignal, arm: int
) -> tuple[DetectorArmState, dict[str, Scalar]]:
    """Return the state of one arm after this tick, and its scores: of each kind of built-in
    detector, and of each of the three steps of detector `steps`.

    params: a DetectorParams. arm: number of the arm.
    """
    motions = signal.mpos, signal.mvel, signal.jpos, signal.jvel
    mpos, mvel, jpos, jvel = (Vec(arms[arm][:POSITIONING]) for arms in motions)
    learned_steps = params.shoulder, params.elbow, params.insertion

    def largest_step(field: str, values: Vec, last_values: Vec) -> Scalar:
        # Returns the largest step of the joints within 1 ms, divided by their learned steps.
        steps = [
            jnp.abs(value - last) / getattr(learned, field)
            for value, last, learned in zip(values, last_values, learned_steps, strict=True)
        ]
        return _largest(setup, steps)

    def derivative_sum(velocities: Vec, last_velocities: Vec) -> Scalar:
        # Returns the sum of |velocity| + |acceleration| over the joints.
        return sum(
            jnp.abs(velocity) + jnp.abs(velocity - last) * (1.0 / TICK_S)
            for velocity, last in zip(velocities, last_velocities, strict=True)
        )

    mvel_step = largest_step("mvel", mvel, before.mvel)
    link_sum, motor_sum = derivative_sum(jvel, before.jvel), derivative_sum(mvel, before.mvel)
    # The control software checks the first six motors.
    ratios = [
        cast_to_real(setup, jnp.abs(command)) / cast_to_real(setup, jnp.maximum(limit, 1))
        for command, limit in zip(signal.command[arm][:6], signal.command_limit[:6], strict=True)
    ]
    scores = {
        "mpos": largest_step("mpos", mpos, before.mpos),
        # A step of velocity counts only if two consecutive ticks have it.
        "mvel": jnp.minimum(mvel_step, before.mvel_step),
        "jpos": largest_step("jpos", jpos, before.jpos),
        "derivative_sum": link_sum + MOTOR_WEIGHT * motor_sum,
        "tip_error": signal.tip_error[arm] * 1e3,
        "overdrive": _largest(setup, ratios),
    }
    return DetectorArmState(mpos, mvel, jpos, jvel, mvel_step), scores


def _score(detector: DetectorUse, scores: dict[str, Scalar]) -> Scalar:
    """Return the score of a built-in detector for one arm, from all scores of this arm. The three
    scores of detector `steps` are fused by the rule `detector.fusion`.
    """
    if detector.kind != "steps":
        return scores[detector.kind]
    # The rules mpos, mvel and jpos use the score of this name.
    if detector.fusion in scores:
        return scores[detector.fusion]
    a, b, c = scores["mpos"], scores["mvel"], scores["jpos"]
    low, high = jnp.minimum(a, b), jnp.maximum(a, b)
    if detector.fusion == "all":
        return jnp.minimum(low, c)
    if detector.fusion == "any":
        return jnp.maximum(high, c)
    # The middle one of three scores.
    return jnp.maximum(low, jnp.minimum(high, c))


def _update_alarms(
    before: DetectorState, thresholds: tuple[Scalar, ...], score: Scalar, tick: Scalar
) -> DetectorState:
    """Return the state of a detector after a tick with this score. An alarm is on while the score
    has exceeded the threshold in the last `consecutive` ticks.
    """
    # `recent` has the scores of the last `consecutive` - 1 ticks.
    lowest = reduce(jnp.minimum, [score, *before.recent])
    threshold_states = []
    for threshold, state in zip(thresholds, before.thresholds, strict=True):
        is_on = lowest > threshold
        begins = is_on & ~state.is_on
        first = first_tick(tick, begins, state.first_tick)
        threshold_states.append(ThresholdState(first, state.alarms + as_int(begins), is_on))
    recent = Vec((score, *before.recent)[: len(before.recent)])
    return DetectorState(recent, jnp.maximum(before.peak, lowest), tuple(threshold_states))
