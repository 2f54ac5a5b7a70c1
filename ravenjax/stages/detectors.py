"""Computes detectors, which score every millisecond of a run and raise an alarm above a threshold.

Built-in detectors do not act on the robot. A user's detector may also stop the robot: its alarm
triggers the E-stop a millisecond later. The score of a tick is the higher score of the two arms.
There are five kinds:

- `steps`: the model-based detector of DSN'16. A dynamic model that gets the written command
  predicts how motors and joints 1-3 move. The virtual robot is used as that model. Three steps
  within 1 ms are scored: of motor position, motor velocity and joint position. A step is divided by
  its learned step, and the largest of the three joints counts. The three scores are then *fused*:
  `all` (the published rule) uses the least of them, `two` the middle score, `any` the largest;
  `mpos`, `mvel` and `jpos` use only that score. As published, a step of velocity counts if two
  ticks in a row have it.
- `derivative_sum`: |link velocities| + |link accelerations| + 0.001 (|motor velocities| + |motor
  accelerations|), summed over joints 1-3, in the authors' mixed units (sys_dyn_gold_euler_detect of
  raven2_sim, threshold 55).
- `tip_error`: distance in mm between nominal model and reported tip, the input of the haptic cue.
- `overdrive`: |current_cmd| divided by the limit at which the control software clips, the largest
  of its checked joints.
- `own`: the score of a user's file (`ravenjax.parts`).

An alarm needs a score above its threshold for `consecutive` milliseconds in a row. The *score of a
run* is the highest threshold at which the run raises an alarm: the largest over time of the least
score in such a span. With this score, one campaign shows the effect of every threshold. Detectors
are active in pedal-down, without a software E-stop, after `armed_after` has passed.
"""

from collections.abc import Sequence
from functools import reduce
from typing import Any

import numpy as np

from ravenjax.bundled import resources
from ravenjax.numbers import Setup, cast_to_real, describe_fields, for_each_arm, jnp, per_arm
from ravenjax.numbers.vec import Scalar, Vec, as_int, first_tick, record
from ravenjax.parts import part
from ravenjax.vocabulary.detectors import DetectorUse
from ravenjax.vocabulary.parts import OwnSource

POSITIONING = 3
TICK_S = 1e-3
MOTOR_SHARE = 0.001
"""Weight of motor derivatives in `derivative_sum`; from raven2_sim."""
LARGEST = 1e30
"""Largest score. Flipped bits can move a reported joint by 1e38 rad, so scores are limited."""

LEARNED: dict[str, list[float]] = resources.read_tables(__file__, "detectors.toml")
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

    armed_after: Scalar  # int32
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
    mvel_step: Scalar  # 1, largest step of motor velocity divided by its threshold


@record
class ThresholdState:
    """The alarms of one threshold of a detector so far."""

    first_tick: Scalar  # int32, tick of the first alarm; -1: none
    alarms: Scalar  # int32, separate alarms
    over: Scalar  # bool, the alarm is on


@record
class DetectorState:
    """The scores and alarms of one detector so far."""

    recent: Vec  # scores of the last `consecutive` - 1 ticks, latest first
    peak: Scalar  # score of the run so far
    thresholds: tuple[ThresholdState, ...]


@record
class DetectorsState:
    arms: tuple[DetectorArmState, ...]
    own: tuple[tuple[Any, ...], ...]  # for each file, one entry per arm
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
    """Return the files of detectors, each once, in order."""
    return tuple(
        dict.fromkeys(detector.part for detector in setup.detectors if detector.part is not None)
    )


def watch_params(setup: Setup) -> WatchParams:
    """Return thresholds of 1, which a campaign replaces."""
    files = detector_files(setup)
    return WatchParams(
        armed_after=np.int32(500),
        own=part.part_parameters(files) if files else (),
        thresholds=tuple((1.0,) * detector.thresholds for detector in setup.detectors),
    )


def params(setup: Setup) -> DetectorParams:
    """Return the parameters of `watch_params`, with the learned steps (`LEARNED`)."""
    steps: dict[str, Any] = {joint: StepScale(*values) for joint, values in LEARNED.items()}
    return DetectorParams(**vars(watch_params(setup)) | steps)


def init(setup: Setup, params: WatchParams) -> DetectorsState:
    """Return the state before the first tick."""
    zero = cast_to_real(setup, 0.0)
    still = Vec.full(POSITIONING, zero)
    threshold = ThresholdState(jnp.int32(-1), jnp.int32(0), jnp.bool_(False))
    detectors = tuple(
        DetectorState(
            Vec.full(detector.consecutive - 1, zero), zero, (threshold,) * detector.thresholds
        )
        for detector in setup.detectors
    )
    memories = tuple(
        for_each_arm(setup, part.load_part(source).init(values, setup.precision.real))
        for source, values in zip(detector_files(setup), params.own, strict=True)
    )
    arms = for_each_arm(setup, DetectorArmState(still, still, still, still, zero))
    return DetectorsState(arms, memories, detectors)


def step(
    setup: Setup, params: WatchParams, state: DetectorsState, signal: WatchSignal
) -> DetectorsState:
    """Return the detectors after this tick."""
    views: Any = for_each_arm(setup, (state.arms[0], {}))
    if isinstance(signal, DetectorSignal):
        views = per_arm(setup, lambda i, _: _arm(setup, params, state.arms[i], signal, i))
    files = {
        source: [
            part.load_part(source).step(
                values, memory, view, setup.precision.real, score=part.SCORE
            )
            for memory, view in zip(before, signal.views, strict=True)
        ]
        for source, values, before in zip(detector_files(setup), params.own, state.own, strict=True)
    }
    armed = signal.armed & (setup.to_ms(signal.tick) >= params.armed_after)
    detectors = []
    for detector, thresholds, before in zip(
        setup.detectors, params.thresholds, state.detectors, strict=True
    ):
        if detector.part is None:
            arms = [_score(detector, scores) for _, scores in views]
        else:
            arms = [score for _, score in files[detector.part]]
        # LARGEST keeps the score finite.
        score = jnp.where(armed, jnp.minimum(_largest(setup, arms), LARGEST), 0.0)
        detectors.append(_watch(before, thresholds, score, signal.tick))
    memories = tuple(tuple(after for after, _ in arms) for arms in files.values())
    return DetectorsState(tuple(arm for arm, _ in views), memories, tuple(detectors))


def detector_stops(setup: Setup, state: DetectorsState | None) -> Scalar:
    """Return whether a detector that may stop the robot is above its threshold, bool."""
    alarms = jnp.bool_(False)
    for declared, detector in zip(setup.detectors, state.detectors, strict=True) if state else ():
        alarms = alarms | detector.thresholds[0].over if declared.stops else alarms
    return alarms


def outcomes(setup: Setup, state: DetectorsState) -> dict[str, Scalar]:
    """Return the outcome columns of a run."""
    out: dict[str, Scalar] = {}
    for d, detector in enumerate(state.detectors):
        out[f"detector{d}_score"] = detector.peak
        for k, threshold in enumerate(detector.thresholds):
            out[f"detector{d}_threshold{k}_first_ms"] = threshold.first_tick
            out[f"detector{d}_threshold{k}_alarms"] = threshold.alarms
    return out


def _largest(setup: Setup, scores: Sequence[Scalar]) -> Scalar:
    """Return the largest score that is not NaN, else 0. A comparison with NaN is false."""
    return reduce(
        lambda most, score: jnp.where(score > most, score, most), scores, cast_to_real(setup, 0.0)
    )


def _arm(
    setup: Setup, params: Any, before: DetectorArmState, signal: DetectorSignal, i: int
) -> tuple[DetectorArmState, dict[str, Scalar]]:
    # Computes the scores of all kinds of detectors for one arm. Returns its new state, scores.
    motion = signal.mpos, signal.mvel, signal.jpos, signal.jvel
    mpos, mvel, jpos, jvel = (Vec(values[i][:POSITIONING]) for values in motion)
    learned = (params.shoulder, params.elbow, params.insertion)

    def largest(field: str, now: Vec, before: Vec) -> Scalar:
        # Returns the largest step of the joints within 1 ms, divided by their learned steps.
        steps = [
            jnp.abs(a - b) / getattr(step, field)
            for a, b, step in zip(now, before, learned, strict=True)
        ]
        return _largest(setup, steps)

    mvel_step = largest("mvel", mvel, before.mvel)
    link_sum, motor_sum = (
        sum(jnp.abs(v) + jnp.abs(v - w) * (1.0 / TICK_S) for v, w in zip(now, then, strict=True))
        for now, then in ((jvel, before.jvel), (mvel, before.mvel))
    )
    ratios = [
        cast_to_real(setup, jnp.abs(command)) / cast_to_real(setup, jnp.maximum(limit, 1))
        for command, limit in zip(signal.command[i][:6], signal.command_limit[:6], strict=True)
    ]
    scores = {
        "mpos": largest("mpos", mpos, before.mpos),
        "mvel": jnp.minimum(mvel_step, before.mvel_step),
        "jpos": largest("jpos", jpos, before.jpos),
        "derivative_sum": link_sum + MOTOR_SHARE * motor_sum,
        "tip_error": signal.tip_error[i] * 1e3,
        "overdrive": _largest(setup, ratios),
    }
    return DetectorArmState(mpos, mvel, jpos, jvel, mvel_step), scores


def _score(detector: DetectorUse, scores: dict[str, Scalar]) -> Scalar:
    # Selects a detector's score, or fuses the three scores of detector `steps`.
    if detector.kind != "steps":
        return scores[detector.kind]
    if detector.fusion in scores:
        return scores[detector.fusion]
    a, b, c = (scores[name] for name in ("mpos", "mvel", "jpos"))
    low, high = jnp.minimum(a, b), jnp.maximum(a, b)
    if detector.fusion == "all":
        return jnp.minimum(low, c)
    return (
        jnp.maximum(high, c) if detector.fusion == "any" else jnp.maximum(low, jnp.minimum(high, c))
    )


def _watch(
    before: DetectorState, thresholds: tuple[Scalar, ...], score: Scalar, tick: Scalar
) -> DetectorState:
    # An alarm begins when the score has exceeded the threshold in all recent ticks.
    lowest = reduce(jnp.minimum, [score, *before.recent])
    after = []
    for threshold, state in zip(thresholds, before.thresholds, strict=True):
        over = lowest > threshold
        begins = over & ~state.over
        first = first_tick(tick, begins, state.first_tick)
        after.append(ThresholdState(first, state.alarms + as_int(begins), over))
    recent = Vec((score, *before.recent)[: len(before.recent)])
    return DetectorState(recent, jnp.maximum(before.peak, lowest), tuple(after))
