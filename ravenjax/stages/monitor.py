"""What the run did to the instrument: deviations, jumps, tissue, DAC peaks. The independent observer of the tick.

Two tips are watched. The *true* tip is where the links of the virtual robot are; the *measured* tip is what the control
software computes from its encoders (whole micrometres), on which the published jump rule works (analyze_faulty.py).
Everything is compared with the nominal model and with the fault-free twin of the run.
"""

from __future__ import annotations

import jax.numpy as jnp

from ravenjax.robot.algebra import dot
from ravenjax.types import JOINTS, Scalar, Setup, Vec, as_int, per_arm, real, record, replace, where

UM = 1e-6


@record
class Reference:
    """The fault-free twin in this tick, one entry an arm."""

    tip: tuple[Vec, ...]  # m, frame 0, true tip
    pos: tuple[Vec, ...]  # um, whole numbers, measured tip


@record
class Params:
    """Limits of the observer."""

    jump_step: Scalar  # m per packet, on two packets in a row; 0.1 mm, CSLDepend/raven2_sim analyze_faulty.py
    large_jump: Scalar  # m within 2 ms; 1 mm, the rule in the text of DSN'16
    diverged: Scalar  # m from the twin above which a run counts as diverged; 1 um, the resolution of `pos`
    idle_share: Scalar  # share of the twin's step below which a step counts as none; a quarter, ours
    idle_step: Scalar  # m per tick, steps of the twin that count; 1 um, the resolution of `pos`
    moved: Scalar  # m from the nominal model above which the instrument counts as moved; 3 mm, the published cue's


@record
class ArmState:
    """What is remembered of one arm."""

    tip: Vec  # m, true tip in the last tick
    tip_before: Vec  # m, true tip in the tick before it
    twin_tip: Vec  # m, the twin's true tip in the last tick
    missed: Vec  # m, sum of the twin's steps while this robot was told to stand, or stood
    pos: Vec  # um, measured tip at the last packet
    twin_pos: Vec  # um, the twin's
    over: Scalar  # bool, the last packet's step was over the jump limit and the twin's was not
    leapt: Scalar  # bool, the true tip's last step was over the jump limit and the twin's was not
    peak_model: Scalar  # m, largest distance from the nominal model
    peak_live: Scalar  # m, the same while the robot was live
    square_model: Scalar  # m^2, sum over ticks
    peak_twin: Scalar  # m, largest distance from the twin
    square_twin: Scalar  # m^2, sum over ticks
    peak_stray: Scalar  # m, largest distance both from the twin and from where standing would have left the tip
    idle_ticks: Scalar  # int32, ticks in which the twin moved and this robot did not
    peak_step: Scalar  # m per tick, largest step of the true tip
    path: Scalar  # m, way of the true tip
    depth: Scalar  # m, deepest penetration of tissue by the true tip; negative: never touched
    peak_dac: Vec  # counts, largest magnitude written to USB
    jump: Scalar  # int32, tick of the first jump by the code's rule; -1: none
    large_jump: Scalar  # int32, tick of the first jump by the text's rule; -1: none
    tip_jump: Scalar  # int32, tick of the first jump by the code's rule on the true tip, tick by tick; -1: none


@record
class State:
    """What the observer remembers."""

    arms: tuple[ArmState, ...]
    tip_distance: Scalar  # m, smallest distance between the two tips; infinite with one arm
    diverged: Scalar  # int32, first tick farther from the twin than the limit; -1: never
    moved: Scalar  # int32, first live tick farther from the nominal model than the limit; -1: never
    failed: Scalar  # int32, first tick in which the true tip was not a finite number; -1: never
    ticks: Scalar  # int32


@record
class Signal:
    """What the observer sees in this tick; one entry an arm."""

    tip: tuple[Vec, ...]  # m, true
    pos: tuple[Vec, ...]  # um, measured
    model_tip: tuple[Vec, ...]  # m
    depth: tuple[Scalar, ...]  # m below the tissue's surface; negative above it
    distance: Scalar  # m between the two tips; infinite with one arm
    dac: tuple[Vec, ...]  # counts, as written
    fresh: Scalar  # bool, a new packet was due in this tick
    live: Scalar  # bool, pedal-down without software E-stop: what the operator asks for is what the robot should do
    tick: Scalar  # int32


def params(setup: Setup) -> Params:
    """The published limits."""
    return Params(jump_step=1e-4, large_jump=1e-3, diverged=1e-6, moved=3e-3, idle_share=0.25, idle_step=1e-6)


def init(setup: Setup, tips: tuple[Vec, ...], positions: tuple[Vec, ...]) -> State:
    """Before the first tick, at rest with the given true [m] and measured [um] tips."""
    zero = real(setup, 0.0)
    never = jnp.int32(-1)

    def arm_state(i: int) -> ArmState:
        tip, pos = real(setup, tips[i]), real(setup, positions[i])
        dac = Vec.full(7, jnp.int32(0))
        depth = real(setup, -jnp.inf)
        still, no = real(setup, Vec.full(3, 0.0)), jnp.bool_(False)
        return ArmState(
            tip=tip,
            tip_before=tip,
            twin_tip=tip,
            missed=still,
            pos=pos,
            twin_pos=pos,
            over=no,
            leapt=no,
            peak_model=zero,
            peak_live=zero,
            square_model=zero,
            peak_twin=zero,
            square_twin=zero,
            peak_stray=zero,
            idle_ticks=jnp.int32(0),
            peak_step=zero,
            path=zero,
            depth=depth,
            peak_dac=dac,
            jump=never,
            large_jump=never,
            tip_jump=never,
        )

    return State(per_arm(setup, lambda i, arm: arm_state(i)), real(setup, jnp.inf), never, never, never, jnp.int32(0))


def _norm(v: Vec) -> Scalar:
    return jnp.sqrt(dot(v, v))


def _first(tick: Scalar, happens: Scalar, before: Scalar) -> Scalar:
    return jnp.where(happens & (before < 0), tick, before)


def _arm(
    params: Params, state: ArmState, signal: Signal, reference: Reference, i: int
) -> tuple[ArmState, Scalar, Scalar]:
    """The arm after this tick, and its distances from twin and nominal model."""
    tip, pos, twin_pos = signal.tip[i], signal.pos[i], reference.pos[i]
    model = _norm(tip - signal.model_tip[i])
    twin_tip = reference.tip[i]
    twin = _norm(tip - twin_tip)
    step = _norm(tip - state.tip)
    asked = twin_tip - state.twin_tip
    twin_step_true = _norm(asked)
    idle = (twin_step_true > params.idle_step) & (step < params.idle_share * twin_step_true)
    missed = where(idle | ~signal.live, state.missed + asked, state.missed)
    stray = jnp.minimum(twin, _norm(tip - twin_tip + missed))
    leapt = (step > params.jump_step) & ~(twin_step_true > params.jump_step)
    both = _norm(tip - state.tip_before)
    packet_step = _norm(pos - state.pos) * UM
    twin_step = _norm(twin_pos - state.twin_pos) * UM
    over = (packet_step > params.jump_step) & ~(twin_step > params.jump_step)
    fresh = signal.fresh
    new = replace(
        state,
        tip=tip,
        tip_before=state.tip,
        twin_tip=twin_tip,
        missed=missed,
        pos=pos.map(lambda a, b: jnp.where(fresh, a, b), state.pos),
        twin_pos=twin_pos.map(lambda a, b: jnp.where(fresh, a, b), state.twin_pos),
        over=jnp.where(fresh, over, state.over),
        leapt=leapt,
        peak_model=jnp.maximum(state.peak_model, model),
        peak_live=jnp.where(signal.live, jnp.maximum(state.peak_live, model), state.peak_live),
        square_model=state.square_model + model * model,
        peak_twin=jnp.maximum(state.peak_twin, twin),
        square_twin=state.square_twin + twin * twin,
        peak_stray=jnp.maximum(state.peak_stray, stray),
        idle_ticks=state.idle_ticks + as_int(idle),
        peak_step=jnp.maximum(state.peak_step, step),
        path=state.path + step,
        depth=jnp.maximum(state.depth, signal.depth[i]),
        peak_dac=state.peak_dac.map(lambda peak, dac: jnp.maximum(peak, jnp.abs(dac)), signal.dac[i]),
        jump=_first(signal.tick, fresh & over & state.over, state.jump),
        large_jump=_first(signal.tick, (step > params.large_jump) | (both > params.large_jump), state.large_jump),
        tip_jump=_first(signal.tick, leapt & state.leapt, state.tip_jump),
    )
    return new, twin, model


def step(setup: Setup, params: Params, state: State, signal: Signal, reference: Reference) -> State:
    """The observer after this tick."""
    arms, twins, models = zip(
        *per_arm(setup, lambda i, arm: _arm(params, state.arms[i], signal, reference, i)), strict=True
    )
    diverged, moved, finite = jnp.bool_(False), jnp.bool_(False), jnp.bool_(True)
    for i, (twin, model) in enumerate(zip(twins, models, strict=True)):
        diverged = diverged | (twin > params.diverged)
        moved = moved | (signal.live & (model > params.moved))
        tip = signal.tip[i]
        total = tip[0] + tip[1] + tip[2]
        finite = finite & (total - total == 0.0)
    return State(
        arms,
        jnp.minimum(state.tip_distance, signal.distance),
        _first(signal.tick, diverged, state.diverged),
        _first(signal.tick, moved, state.moved),
        _first(signal.tick, ~finite, state.failed),
        state.ticks + as_int(True),
    )


def outcomes(setup: Setup, state: State) -> dict[str, Scalar]:
    """Outcome columns of a run: lengths in mm, ticks in ms; worst over the arms."""

    def worst(name: str) -> Scalar:
        values = [getattr(arm, name) for arm in state.arms]
        result = values[0]
        for value in values[1:]:
            result = jnp.maximum(result, value)
        return result

    def earliest(name: str) -> Scalar:
        result = jnp.int32(-1)
        for arm in state.arms:
            tick = getattr(arm, name)
            result = jnp.where((tick >= 0) & ((result < 0) | (tick < result)), tick, result)
        return result

    count = jnp.maximum(state.ticks, 1)
    out = {
        "peak_model_deviation_mm": worst("peak_model") * 1e3,
        "peak_live_deviation_mm": worst("peak_live") * 1e3,
        "rms_model_deviation_mm": jnp.sqrt(worst("square_model") / count) * 1e3,
        "peak_twin_deviation_mm": worst("peak_twin") * 1e3,
        "rms_twin_deviation_mm": jnp.sqrt(worst("square_twin") / count) * 1e3,
        "stray_mm": worst("peak_stray") * 1e3,
        "idle_ms": worst("idle_ticks"),
        "largest_step_mm": worst("peak_step") * 1e3,
        "tip_path_mm": worst("path") * 1e3,
        "moved_first_ms": state.moved,
        "tissue_depth_mm": worst("depth") * 1e3,
        "tip_distance_mm": state.tip_distance * 1e3,
        "jump_code_ms": earliest("jump"),
        "jump_text_ms": earliest("large_jump"),
        "jump_tip_ms": earliest("tip_jump"),
        "diverged_ms": state.diverged,
        "failed_ms": state.failed,
    }
    for arm, arm_state in zip(setup.arms, state.arms, strict=True):
        for joint, peak in zip(JOINTS, arm_state.peak_dac, strict=True):
            out[f"peak_dac_{arm}_{joint}"] = peak
    return out
